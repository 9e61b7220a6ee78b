"""Which targets of a run are shown, and what the stages found in their frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float

from hlp.method.find.trace import Trace
from hlp.records import Frame, PoseEstimate, Target, TargetScore, frame_key
from hlp.results.summary_file import TargetKey, numbered_targets
from hlp.stages.detection import DetectionStages

MISSED, RIGHT = 300, 8
"""The largest numbers of missed and of right targets that a run's page shows: each takes some
tenths of a second and 0.2 MB."""
Scored = Mapping[str, Sequence[TargetScore]]
"""The scores of each frame that could be used, in the order of its targets."""
_Item = TypeVar("_Item")


@dataclass(frozen=True)
class FrameResults:
    """A frame with what the stages found in it, and the answers."""

    frame: Frame
    trace: Trace
    estimates: tuple[PoseEstimate, ...]

    @classmethod
    def read(
        cls, detection: DetectionStages, key: str, estimates: Sequence[PoseEstimate]
    ) -> "FrameResults":
        """What lies on disk of a frame that did not fail; `estimates` are the run's."""
        here = [e for e in estimates if frame_key(e.scene_id, e.frame_id) == key]
        return cls(detection.load(key), detection.read(key), tuple(here))

    @property
    def targets(self) -> list[Target]:
        """The frame's targets as they are scored: by object, in the order of first appearance."""
        objects = dict.fromkeys(target.object_id for target in self.frame.targets)
        return [target for i in objects for target in self.frame.targets if target.object_id == i]

    def nearest(self, target: Target) -> PoseEstimate | None:
        """The answer for the target's object that is nearest to its true place."""

        def distance(estimate: PoseEstimate) -> float:
            assert estimate.pose_cam_obj is not None
            apart = estimate.pose_cam_obj[:3, 3] - target.pose_cam_obj[:3, 3]
            return float(np.linalg.norm(apart))

        found = (
            estimate
            for estimate in self.estimates
            if estimate.object_id == target.object_id and estimate.pose_cam_obj is not None
        )
        return min(found, key=distance, default=None)

    def coarse(
        self, object_id: int, estimate: PoseEstimate | None
    ) -> Float[np.ndarray, "4 4"] | None:
        """The coarse pose that became the estimate; without an estimate the best one.

        None if there is none: the fallback finds poses without any.
        """
        found = self.trace[object_id]
        poses = np.zeros((0, 4, 4)) if found.hypotheses is None else found.hypotheses.poses_cam_obj
        row = self.row(object_id, estimate)
        if row is None or found.refined is None:
            return poses[0] if len(poses) else None
        source = int(found.refined.sources[row])
        return poses[source] if 0 <= source < len(poses) else None

    def row(self, object_id: int, estimate: PoseEstimate | None) -> int | None:
        """Which of the object's refined poses is the estimate; None without one."""
        refined = self.trace[object_id].refined
        if estimate is None or estimate.pose_cam_obj is None or refined is None:
            return None
        poses = np.stack([found.pose_cam_obj for found in refined.refined])
        return int(np.abs(poses - estimate.pose_cam_obj).max(axis=(1, 2)).argmin())


class PageTarget(NamedTuple):
    """A target on the run's page: its key, its frame's, its place among those of the frame."""

    target: TargetKey
    frame: str
    place: int


def page_targets(scored: Scored) -> list[PageTarget]:
    """Missed targets, and right ones, each spread evenly over the run if there are too many."""
    missed, right = (_targets(scored, verdict) for verdict in (False, True))
    return sorted([*spread(missed, MISSED), *spread(right, RIGHT)])


def missed_targets(scored: Scored, most: int) -> list[tuple[str, int]]:
    """Frames of missed targets and their places, up to a number, spread evenly over the run."""
    return [(missed.frame, missed.place) for missed in spread(_targets(scored, False), most)]


def _targets(scored: Scored, right: bool) -> list[PageTarget]:
    found = []
    for key, scores in scored.items():
        targets = numbered_targets((s.scene_id, s.frame_id, s.object_id) for s in scores)
        for place, (target, score) in enumerate(zip(targets, scores, strict=True)):
            if score.add_correct == right:
                found.append(PageTarget(target, key, place))
    return found


def spread(items: Sequence[_Item], most: int) -> list[_Item]:
    """`most` of the items, or all, spread evenly."""
    count = min(most, len(items))
    return [items[i * len(items) // count] for i in range(count)]
