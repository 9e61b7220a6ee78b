"""The stages over a run's frames, and what is said of the frames that cannot be used."""

import logging
from collections.abc import Mapping, Sequence

from hlp.config.build import Run
from hlp.data.dataset import CheckedFrames
from hlp.errors import DataError
from hlp.evaluation.waterfall import BAD_FRAME, missed_score
from hlp.records import TargetScore, frame_key, parse_frame_key
from hlp.reporting.tables.table import prose
from hlp.stages.detection import DetectionStages, OnBadFrame
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages

_NAMED = 10  # frames that the last message names
_logger = logging.getLogger(__name__)


def stages_of(run: Run, store: StageStore, on_bad_frame: OnBadFrame = "fail") -> DetectionStages:
    """Training and detection stages over the run's frames; nothing is computed yet.

    `on_bad_frame` "report" is for those who count the targets of bad frames as wrong. Raises
    DataError for the first frame that is known to be bad, with "fail".
    """
    if on_bad_frame == "fail":
        run.require_sound_frames()
    settings = run.settings
    training = TrainingStages(run.dataset, settings.method, store, settings.warm_start)
    return DetectionStages(
        run.dataset,
        settings.method,
        training,
        store,
        run.keys,
        settings.executor,
        on_bad_frame,
        run.bad_frames,
    )


def require_some(failed: Mapping[str, str], frames: int) -> None:
    """Raise DataError if all of a run's frames have failed."""
    if len(failed) == frames:
        first = next(iter(failed.values()))
        raise DataError(f"none of the {frames} frames can be used; the first: {first}")


def with_failed_frames(
    run: Run, failed: Mapping[str, str], scores: Sequence[TargetScore]
) -> list[TargetScore]:
    """The scores and those of the frames that failed, in the order of the run's frames."""
    if not failed:
        return list(scores)
    source = run.dataset.frames
    assert isinstance(source, CheckedFrames)  # of others, a bad frame ends the run
    lost = [
        missed_score(*parse_frame_key(key), t.object_id, t.visible_fraction, cause=BAD_FRAME)
        for key in failed
        for t in source.stated_targets(key)
    ]
    place = {key: number for number, key in enumerate(run.keys)}
    return sorted([*scores, *lost], key=lambda s: place[frame_key(s.scene_id, s.frame_id)])


def describe_failed(failed: Mapping[str, str]) -> list[dict[str, object]]:
    """`frames_failed` of `summary.json`: the frames and the reasons."""
    described: list[dict[str, object]] = []
    for key, reason in sorted(failed.items()):
        scene_id, frame_id = parse_frame_key(key)
        described.append({"scene_id": scene_id, "im_id": frame_id, "reason": reason})
    return described


def report_bad_frames(run: Run) -> None:
    """One line for each frame that is known to be bad before the first stage."""
    for key, reason in run.bad_frames.items():
        _logger.warning("frame %s cannot be used: %s", key, reason)


def say_failed(failed: Mapping[str, str], frames: int) -> None:
    """What a run says of them at its end; nothing if there is none."""
    if not failed:
        return
    named = ", ".join(sorted(failed)[:_NAMED])
    more = ", …" if len(failed) > _NAMED else ""
    words = (
        f"{len(failed)} of {frames} frames could not be used; their targets count as wrong: "
        f"{named}{more} (the reasons are in summary.json)"
    )
    _logger.warning("\n%s", prose(words, "text"))
