"""Times of runs that find their poses on disk: measured again, and said to be."""

from collections.abc import Callable

import pytest

from run_files import read_json, rows
from tiny_run import TinyRun

Call = Callable[..., tuple[int, str, str]]
STAGES = ["regions", "hypotheses", "poses"]


def test_the_first_run_reports_its_own_times_and_the_first_use_apart(tiny_run: TinyRun) -> None:
    summary = read_json(tiny_run.output / "summary.json")
    timing = summary["timing"]
    assert (timing["frames"], timing["reused_stages"]) == (2, [])
    assert timing["objects"] == summary["targets"]
    times = [float(row["time"]) for row in rows(tiny_run.output / "poses.csv")]
    assert timing["first_use_seconds"] > 0.0
    assert min(times) > 0.0
    assert "Times: measured by this run on 2 frames." in tiny_run.process.stdout


@pytest.mark.slow
@pytest.mark.thorough
def test_a_sweep_over_threads_measures_each_of_its_runs(tiny_run: TinyRun, call: Call) -> None:
    """All stages are on disk, since threads change no result; the times are not."""
    own = ("timing_frames=1", "output=threads")
    code, said, error = call("-m", *tiny_run.overrides, *own, "machine.threads=1,2")
    assert code == 0, error
    found = [read_json(tiny_run.folder / "threads" / name / "summary.json") for name in "01"]
    first = read_json(tiny_run.output / "summary.json")
    for summary in found:
        assert summary["metrics"] == first["metrics"]
        assert summary["timing"]["reused_stages"] == STAGES
        assert summary["timing"]["frames"] == 1
        assert 0 < summary["timing"]["objects"] < first["timing"]["objects"]
    times = [summary["timing_ms"]["total"]["median"] for summary in (first, *found)]
    assert len(set(times)) == 3
    words = " ".join(said.split())  # lines of a terminal
    assert words.count("were reused; measured again on 1 frame.") == 2
    for name in "01":
        poses = rows(tiny_run.folder / "threads" / name / "poses.csv")
        assert {row["time"] for row in poses} == {"-1.0"}
