"""MLflow's database on disk: cut off while it is made, damaged, moved; runs of dead processes."""

import json
import os
import shutil
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from urllib.parse import unquote

import pytest
from mlflow import MlflowClient

from hlp.reporting import mlflow as store
from hlp.reporting.mlflow import owner_is_dead, owner_tags, prepare_database, remove_database
from hlp.reporting.mlflow.tracking import MlflowSettings, track_run


def client_of(folder: Path) -> MlflowClient:
    return MlflowClient(f"sqlite:///{folder / 'mlflow.db'}")


def run(folder: Path) -> str:
    """The id of a new run in the database of a folder."""
    settings = MlflowSettings(uri=f"sqlite:///{folder / 'mlflow.db'}")
    with track_run(settings, "demo", {"seed": 0}) as tracker:
        pass
    return tracker.run_id


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a database of one run, which has an artifact."""
    folder = tmp_path_factory.mktemp("made")
    run(folder)
    return folder


def test_nothing_but_a_whole_database_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cut_off(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(store.os, "replace", cut_off)
        with pytest.raises(KeyboardInterrupt):
            prepare_database(tmp_path / "mlflow.db")
    assert not (tmp_path / "mlflow.db").exists()
    for ending in ("", "-journal"):
        (tmp_path / f".mlflow.db.new{ending}").write_bytes(b"half")
    run(tmp_path)
    names = {path.name for path in tmp_path.iterdir() if path.suffix != ".lock"}
    assert names == {"mlflow.db", "mlflow-artifacts"}


DAMAGE = {
    "empty": lambda content: b"",
    "garbage": lambda content: os.urandom(5000),
    "cut": lambda content: content[: len(content) // 2],
    "header": lambda content: b"x" + content[1:],
    "page": lambda content: content[:8192] + os.urandom(4096) + content[12288:],
}


@pytest.mark.parametrize("how", DAMAGE)
def test_a_damaged_database_is_kept_and_a_new_one_begun(
    made: Path, tmp_path: Path, how: str, caplog: pytest.LogCaptureFixture
) -> None:
    database = tmp_path / "mlflow.db"
    damaged = DAMAGE[how]((made / "mlflow.db").read_bytes())
    database.write_bytes(damaged)
    run_id = run(tmp_path)
    assert client_of(tmp_path).get_run(run_id).info.status == "FINISHED"
    if damaged:
        assert (tmp_path / "mlflow.db.damaged").read_bytes() == damaged
        (message,) = [line for line in caplog.messages if "is damaged" in line]
        assert str(database) in message


def test_a_folder_of_its_name_is_kept_too(tmp_path: Path) -> None:
    (tmp_path / "mlflow.db").mkdir()
    prepare_database(tmp_path / "mlflow.db")
    assert (tmp_path / "mlflow.db").is_file() and (tmp_path / "mlflow.db.damaged").is_dir()


def test_a_sound_database_is_left_alone(made: Path, caplog: pytest.LogCaptureFixture) -> None:
    before = len(client_of(made).search_runs(["1"]))
    run(made)
    assert len(client_of(made).search_runs(["1"])) == before + 1
    assert caplog.messages == []


def test_another_programs_database_is_not_touched(tmp_path: Path) -> None:
    database = tmp_path / "theirs.db"
    with closing(sqlite3.connect(database)) as connection:
        connection.execute("create table notes (text)")
        connection.commit()
    before = database.read_bytes()
    prepare_database(database)
    assert database.read_bytes() == before


def test_a_moved_folder_keeps_its_artifacts_and_gets_the_new_ones(
    made: Path, tmp_path: Path
) -> None:
    moved = Path(shutil.copytree(made, tmp_path / "moved ö"))
    before = {path.name for path in (made / "mlflow-artifacts").iterdir()}
    run_id = run(moved)
    for logged in client_of(moved).search_runs(["1"]):
        folder = Path(unquote(logged.info.artifact_uri.removeprefix("file://")))
        assert folder.is_relative_to(moved)
        assert (folder / "config.yaml").is_file()
    assert (moved / "mlflow-artifacts" / run_id / "artifacts" / "config.yaml").is_file()
    assert {path.name for path in (made / "mlflow-artifacts").iterdir()} == before


def test_removing_a_database_leaves_what_lies_beside_it(made: Path, tmp_path: Path) -> None:
    alone, shared = (Path(shutil.copytree(made, tmp_path / name)) for name in ("alone", "shared"))
    (shared / "notes.txt").write_text("mine")
    for folder in (alone, shared):
        remove_database(folder / "mlflow.db")
    assert not alone.exists()
    assert [path.name for path in shared.iterdir()] == ["notes.txt"]


def test_a_process_that_ended_is_dead_also_before_it_is_waited_for() -> None:
    assert not owner_is_dead(owner_tags())
    code = "import json; from hlp.reporting.mlflow import owner_tags as tags"
    code += "; print(json.dumps(tags()))"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    tags = json.loads(process.stdout.read())
    if sys.platform == "linux":
        while ") Z " not in Path(f"/proc/{process.pid}/stat").read_text():
            time.sleep(0.01)
        assert owner_is_dead(tags)
    process.communicate()
    assert owner_is_dead(tags)

    # Another process with its id, on Linux, where start times are known.
    assert owner_is_dead(owner_tags() | {"hlp.process_started": "1"}) == (sys.platform == "linux")


@pytest.mark.parametrize(
    "tags",
    [{}, *(owner_tags() | {f"hlp.{key}": value} for key, value in (
        ("host", "another"), ("process", "x"), ("process", ""), ("process", "-1"),
    ))],
)  # fmt: skip
def test_what_cannot_be_known_counts_as_alive(tags: dict[str, str]) -> None:
    assert not owner_is_dead(tags)
