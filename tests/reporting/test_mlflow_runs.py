from pathlib import Path

import pytest

from hlp.reporting import mlflow_runs as reading
from hlp.reporting.mlflow_runs import differences_table, read_runs, scores_file
from hlp.reporting.tracking import TrackingSettings, track_run


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> TrackingSettings:
    """Two finished runs and a crashed one, in this order."""
    uri = f"sqlite:///{tmp_path_factory.mktemp('runs') / 'mlflow.db'}"
    settings = TrackingSettings(name="mlflow", uri=uri, experiment="hlp")
    for name, particles, recall in (("first", 25, 0.5), ("second", 50, 0.75)):
        params = {"seed": 0, "refinement": {"particles": particles}}
        with track_run(settings, name, {}, params=params) as tracker:
            tracker.log_metrics({"add": recall})
    with (
        pytest.raises(ValueError, match="no depth"),
        track_run(settings, "third", {}, params={"seed": "0"}),
    ):
        raise ValueError("no depth")
    return settings


def test_runs_come_newest_first_with_what_was_logged(settings: TrackingSettings) -> None:
    found = read_runs(settings)
    assert [run.name for run in found] == ["third", "second", "first"]
    assert [run.status for run in found] == ["FAILED", "FINISHED", "FINISHED"]
    assert found[1].params == {"seed": "0", "refinement.particles": "50"}
    assert found[1].metrics == {"add": 0.75}
    assert found[1].started <= found[0].started


def test_pages_are_joined(settings: TrackingSettings, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "_PER_PAGE", 2)
    assert [run.name for run in read_runs(settings)] == ["third", "second", "first"]


def test_table_shows_the_settings_that_differ(settings: TrackingSettings) -> None:
    table = differences_table(read_runs(settings), ["add"])
    assert list(table.header) == ["run", "status", "refinement.particles", "add"]
    assert list(table.rows) == [
        ["third", "FAILED", "", ""],
        ["second", "FINISHED", "50", "0.750"],
        ["first", "FINISHED", "25", "0.500"],
    ]


def test_nothing_to_read_is_named_and_not_made(settings: TrackingSettings, tmp_path: Path) -> None:
    absent = TrackingSettings("mlflow", f"sqlite:///{tmp_path / 'mlflow.db'}", "hlp")
    with pytest.raises(FileNotFoundError, match=r"mlflow\.db"):
        read_runs(absent)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ValueError, match="no experiment 'other'"):
        read_runs(TrackingSettings("mlflow", settings.uri, "other"))


def test_scores_are_found_by_folder_and_by_run(settings: TrackingSettings, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    path = tmp_path / "out" / "scores.csv"
    with pytest.raises(FileNotFoundError, match="no finished run"):
        scores_file(str(path.parent), settings.uri)
    path.write_text("scene_id\n")
    assert scores_file(str(path.parent), settings.uri) == path
    other = TrackingSettings("mlflow", settings.uri, "scored")
    with track_run(other, "scored", {}) as tracker:
        tracker.log_artifact(path)
    assert scores_file(tracker.run_id, settings.uri).read_text() == "scene_id\n"
    with pytest.raises(FileNotFoundError, match="no folder nowhere"):
        scores_file("nowhere", settings.uri)
    with pytest.raises(FileNotFoundError, match="no MLflow database"):
        scores_file("nowhere", f"sqlite:///{tmp_path / 'absent.db'}")
    assert not (tmp_path / "absent.db").exists()
