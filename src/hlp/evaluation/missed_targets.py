"""Scores of targets that got no pose: they are wrong."""

from collections.abc import Iterable

from hlp.evaluation.waterfall import BAD_FRAME
from hlp.records import TargetScore


def missed_score(
    scene_id: int,
    frame_id: int,
    target: tuple[int, float],
    bop_recalls: tuple[float, float, float],
    cause: str = "",
) -> TargetScore:
    """The score of a target (object id, visible fraction) without a pose.

    `bop_recalls` are those of VSD, MSSD and MSPD.
    """
    infinite = float("inf")
    vsd, mssd, mspd = bop_recalls
    return TargetScore(
        scene_id,
        frame_id,
        target[0],
        found=False,
        visible_fraction=target[1],
        add_error=infinite,
        rotation_error=infinite,
        translation_error=infinite,
        box_iou=0.0,
        add_correct=False,
        pose_correct=False,
        box_correct=False,
        vsd_recall=vsd,
        mssd_recall=mssd,
        mspd_recall=mspd,
        cause=cause,
    )


def bad_frame_scores(
    scene_id: int, frame_id: int, targets: Iterable[tuple[int, float]]
) -> list[TargetScore]:
    """One score for each target (object id, visible fraction) of a frame that cannot be used."""
    nothing = (0.0, 0.0, 0.0)
    return [missed_score(scene_id, frame_id, each, nothing, BAD_FRAME) for each in targets]
