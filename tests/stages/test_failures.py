"""A frame whose files are broken costs itself: its files hold the reason, the others their bits."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fake_detection import (
    KEYS,
    CountedFrames,
    FakeEstimator,
    FakeTraining,
    fake_dataset,
    method_settings,
)
from hlp.data.dataset import StatedTarget
from hlp.errors import DataError, MissingFileError
from hlp.records import Frame
from hlp.stages import detection
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore
from hlp.stages.trace_files import read_arrays, read_trace

SETTINGS = method_settings()
BAD = KEYS[1]


class BreakingFrames(CountedFrames):
    """Frames of which one cannot be decoded; its targets are known all the same."""

    error: Exception = DataError("depth/000002.png is truncated")

    def load(self, key: str) -> Frame:
        frame = super().load(key)
        if key == BAD:
            raise self.error
        return frame

    def check(self, key: str, models: Any) -> None:
        """Nothing is seen without decoding."""

    def stated_targets(self, key: str) -> tuple[StatedTarget, ...]:
        return (StatedTarget(3),)


@pytest.fixture(autouse=True)
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detection, "PoseEstimator", FakeEstimator)


def stages_in(work: Path, frames: Any = None, **options: Any) -> Any:
    dataset = SimpleNamespace(**{**vars(fake_dataset()), "frames": frames or BreakingFrames()})
    training: Any = FakeTraining()
    return DetectionStages(dataset, SETTINGS, training, StageStore(work), KEYS, **options)  # type: ignore[arg-type]


def assert_same(stages: Any, sound: Any) -> None:
    """All frames but the bad one hold the same bits."""
    for stage, output in stages.made.items():
        for key in set(KEYS) - {BAD}:
            found = read_arrays(output.folder, key)
            wanted = read_arrays(sound.made[stage].folder, key)
            assert found.keys() == wanted.keys()
            for name in found:
                np.testing.assert_array_equal(found[name], wanted[name])


def test_the_others_are_found_bit_for_bit(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    stages, seen = stages_in(tmp_path / "bad", on_bad_frame="report"), []
    estimates = stages.estimates(lambda key, found: seen.append(key))
    assert seen == [KEYS[0], KEYS[2]]
    assert {(e.scene_id, e.frame_id) for e in estimates} == {(0, 1), (4, 1)}
    assert stages.failed == {BAD: "depth/000002.png is truncated"}
    (line,) = [each.message for each in caplog.records if each.levelname == "WARNING"]
    assert BAD in line and "depth/000002.png is truncated" in line
    sound = stages_in(tmp_path / "sound", CountedFrames())
    sound.estimates()
    assert_same(stages, sound)
    stored = read_trace({"poses": stages.made["poses"].folder}, BAD)
    assert stored == "depth/000002.png is truncated"


def test_another_run_reads_of_the_failure_on_disk(tmp_path: Path) -> None:
    stages_in(tmp_path, on_bad_frame="report").estimates()
    again = stages_in(tmp_path, on_bad_frame="report")
    assert len(again.estimates()) == 4
    assert again.failed == {BAD: "depth/000002.png is truncated"}
    with pytest.raises(DataError, match="truncated"):
        stages_in(tmp_path).estimates()


def test_a_frame_known_to_be_bad_is_not_decoded_and_has_a_result_of_its_own(tmp_path: Path) -> None:
    frames = CountedFrames()
    stages = stages_in(tmp_path, frames, on_bad_frame="report", bad_frames={BAD: "no image"})
    assert len(stages.estimates()) == 4
    assert frames.loads == [KEYS[0], KEYS[2]]
    assert stages.failed == {BAD: "no image"}
    sound = stages_in(tmp_path, CountedFrames())
    sound.estimates()
    assert sound.made["poses"].fingerprint != stages.made["poses"].fingerprint
    assert_same(stages, sound)


@pytest.mark.parametrize(
    ("options", "error", "of_files"),
    [
        ({}, DataError("truncated"), True),  # the default of studies, which need every frame
        ({"on_bad_frame": "report"}, MissingFileError("it has gone"), True),  # during the run
        ({"on_bad_frame": "report"}, KeyError("a bug"), True),
        ({"on_bad_frame": "report"}, DataError("truncated"), False),  # its targets are not known
    ],
)
def test_everything_else_ends_the_run(
    tmp_path: Path, options: Any, error: Exception, of_files: bool
) -> None:
    frames = BreakingFrames()
    frames.error = error
    if not of_files:
        frames = SimpleNamespace(**{n: getattr(frames, n) for n in ("keys", "load", "identity")})  # type: ignore[assignment]
    with pytest.raises(type(error)):
        stages_in(tmp_path, frames, **options).estimates()
