"""What is printed fits a terminal of 80 columns, but for lines that name a path."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from hlp.commands import report
from hlp.data.synthetic.objects import demo_objects
from hlp.evaluation.waterfall import CAUSES
from hlp.records import TargetScore
from hlp.reporting.summary_tables import ADD_BY_OBJECT, format_summary
from hlp.results.poses_file import write_scores
from written_results import quality, scored, write_run, write_sweep


def whole_summary(names: Sequence[str] = tuple(ADD_BY_OBJECT)) -> dict[str, Any]:
    """A summary with all that a run may have to say."""
    written = scored(0.75, 1234.5, dict.fromkeys(names, 0.75))
    causes, votes = dict.fromkeys(("correct", *CAUSES), 20), quality(0.25, 1200.0)
    many = {"answers": 12345, "ece": 0.0123, "ece_by_chance": 0.0123, "aurc": 0.0123}
    alarms = {"alarms": 123, "searched": 12345, "rate": 0.0123}
    return {
        **written,
        "calibration": {**written["calibration"], **many},
        "false_alarms": {**written["false_alarms"], **alarms},
        "timing": {
            **written["timing"],
            "reused_stages": ["regions", "hypotheses", "poses"],
            "first_use_seconds": 12.3,
            "cpu_ms": 1234.5,
        },
        "waterfall": {
            "total": causes,
            "per_object": dict.fromkeys(names, causes),
            "per_visibility": {"0.6-1": causes},
        },
        "votes": {"total": votes, "per_object": dict.fromkeys(names, votes)},
    }


def wider(printed: str) -> list[str]:
    """The lines of more than 80 columns; a word that names a path does not count."""
    lines = printed.splitlines()
    return [line for line in lines if len(line) > 80 and "/" not in max(line.split(), key=len)]


def write_verdicts(folder: Path, wrong: int) -> None:
    names = {5: "can", 6: "holepuncher_of_steel"}
    scores = [
        TargetScore(1, i, number, True, 0.75, 0.1234, 3.1, 0.1234, 0.9, i != wrong, True, True)
        for number in names
        for i in range(20)
    ]
    write_scores(folder / "scores.csv", scores, names)


def test_the_end_of_a_run() -> None:
    assert not wider(format_summary(whole_summary()))
    assert not wider(format_summary(whole_summary([item.name for item in demo_objects().values()])))
    assert not wider(format_summary(whole_summary(["a_very_long_name_of_an_object_" * 3])))
    assert max(map(len, format_summary(whole_summary(), "markdown").splitlines())) > 80


def test_the_report_of_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_run(tmp_path / "run", "demo", whole_summary())
    report.report([f"output={tmp_path / 'run'}"])
    printed = capsys.readouterr().out
    assert "targets ended as" in printed and "good of these" in printed
    assert not wider(printed)


def test_the_report_of_a_sweep(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of three experiments at once: one without a report, a table of the paper, a figure."""
    sweep = write_sweep(tmp_path / "sweep", ["refinement.particles", "experiment"], ["seed=5"])
    for number, name in enumerate(("demo", "table1", "fig9b")):
        given = [f"refinement.particles={15 * number}", f"experiment={name}"]
        particles = {"particles": 15 * number}
        run = write_run(sweep / str(number), name, whole_summary(), given, refinement=particles)
        write_verdicts(run, number)
    report.report([f"output={tmp_path}"])
    printed = capsys.readouterr().out
    assert "3 of 3 runs finished" in printed and "All runs below" in printed
    assert "Table 1" in printed and "Fig. 9b" in printed
    assert not wider(printed)


@pytest.mark.parametrize("runs", ["ab", "abc"])
def test_the_comparison_of_runs(
    runs: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = []
    for wrong, name in enumerate(runs):
        folders.append(write_run(tmp_path / ("x" * 60) / name, "demo", whole_summary()))
        write_verdicts(folders[-1], wrong)
    report.report([f"runs=[{','.join(map(str, folders))}]"])
    printed = capsys.readouterr().out
    assert ("p is McNemar's" in textwrap.fill(printed, 10_000)) == (len(runs) == 2)
    assert not wider(printed)
