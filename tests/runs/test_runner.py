"""What is written of a run's estimates."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hlp.records import PoseEstimate
from hlp.results.poses_file import read_poses
from hlp.runs import runner

WHOLE = {"holistic": 0.5, "local": 0.25, "voting": 0.125, "refinement": 0.125}


def written(monkeypatch: pytest.MonkeyPatch, folder: Path, estimates: list[PoseEstimate]) -> Any:
    """What poses.csv holds, written before anything else is done with the estimates."""

    class WrittenError(Exception):
        pass

    def stop(*_: Any, **__: Any) -> None:
        raise WrittenError

    monkeypatch.setattr(runner, "read_poses", stop)
    run: Any = SimpleNamespace(dataset=None, settings=None)
    nothing: Any = None
    with pytest.raises(WrittenError):
        runner._score(run, nothing, estimates, [], nothing, {}, folder)
    return read_poses(folder / "poses.csv")


def test_the_time_of_objects_that_were_not_found_counts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    estimates = [
        PoseEstimate(6, 1, 1, None, 0.0, WHOLE),
        PoseEstimate(6, 1, 2, np.eye(4), 0.9, WHOLE),
    ]
    (found,) = written(monkeypatch, tmp_path, estimates)
    assert (found.object_id, found.seconds) == (2, {"total": 2.0})
