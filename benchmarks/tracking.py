"""How often a tracker is right in a recorded sequence, and how long a frame takes.

    python benchmarks/tracking.py learnt/mustard ../shared/data/mustard

The frames of a data set in BOP's layout are one sequence for a learnt object of the same shape.
Printed are, for tracking and for detection in every frame, the share of targets whose pose is right
(ADD-S, and ADD, below a tenth of the diameter), the share of instances that were tracked and not
detected anew, and the median time of a frame in which all were tracked, and of one in which not:
wall time, and CPU time, which other programs on the machine change less.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from hlp import Detection, Detector, TrackedDetection, TrackingSettings
from hlp.data.bop import BopSettings
from hlp.evaluation.errors import add, add_s
from hlp.records import Frame, ObjectModel

Found = TypeVar("Found", bound=Sequence[Detection])
Error = Callable[[np.ndarray, np.ndarray, np.ndarray], float]


def main() -> None:
    """Track, detect, compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("learnt", type=Path, help="folder with one learnt object")
    parser.add_argument("data", type=Path, help="data set that shows it")
    parser.add_argument("--instances", type=int, default=1, help="of the object in a frame")
    parser.add_argument("--min-score", type=float, default=0.5)
    parser.add_argument("--each", action="store_true", help="print a line for each frame")
    given = parser.parse_args()
    detector = Detector.load(given.learnt)
    (model,) = detector.models.values()
    source = BopSettings(root=str(given.data)).build().frames
    frames = [source.load(key) for key in source.keys]
    settings = TrackingSettings(min_score=given.min_score)
    for _ in range(2):  # the first time compiles and loads
        tracker = detector.tracker(None, given.instances, settings)
        tracked, tracked_ms = timed(tracker.update, frames)

    def detect(frame: Frame) -> list[Detection]:
        image = frame.rgb, frame.depth, frame.camera_matrix
        return detector.detect(*image, None, given.instances, given.min_score)

    detected, detected_ms = timed(detect, frames)
    report("tracking", frames, tracked, model)
    report("detection", frames, detected, model)
    answers = [each for found in tracked for each in found]
    followed = sum(each.tracked for each in answers)
    print(f"{followed} of {len(answers)} instances tracked, the others detected")
    calm = np.array([all(e.tracked for e in f) and len(f) == given.instances for f in tracked])
    for name, chosen in (("all tracked", calm), ("not all tracked", ~calm)):
        if chosen.any():
            print(f"{chosen.sum()} frames {name}: {in_words(tracked_ms[chosen])}")
    print(f"detection: {in_words(detected_ms)}")
    if given.each:
        for frame, found, spent in zip(frames, tracked, tracked_ms, strict=True):
            print_frame(frame, found, spent[0], model)


def timed(
    find: Callable[[Frame], Found], frames: Sequence[Frame]
) -> tuple[list[Found], np.ndarray]:
    """Answers to all frames, and the milliseconds that each took: wall and CPU time."""
    answers: list[Found] = []
    spent = []
    for frame in frames:
        begun = time.perf_counter(), time.process_time()
        answers.append(find(frame))
        spent.append([time.perf_counter() - begun[0], time.process_time() - begun[1]])
    return answers, 1000.0 * np.array(spent)


def in_words(spent_ms: np.ndarray) -> str:
    """Medians of wall and CPU times (n, 2)."""
    wall, cpu = np.median(spent_ms, axis=0)
    return f"{wall:.1f} ms, CPU {cpu:.1f} ms (medians)"


def right(frame: Frame, found: Sequence[Detection], model: ObjectModel, error: Error) -> int:
    """How many targets have a right pose of their own."""
    left = list(found)
    count = 0
    for target in frame.targets:
        for each in left:
            apart = error(each.pose_cam_obj, target.pose_cam_obj, model.mesh.vertices)
            if apart < 0.1 * model.diameter:
                left.remove(each)
                count += 1
                break
    return count


def report(
    name: str, frames: Sequence[Frame], answers: Sequence[Sequence[Detection]], model: ObjectModel
) -> None:
    """Print the shares of right targets, and the answers that are wrong."""
    targets = sum(len(frame.targets) for frame in frames)
    shares = [
        sum(right(*each, model, error) for each in zip(frames, answers, strict=True))
        for error in (add_s, add)
    ]
    wrong = sum(map(len, answers)) - shares[0]
    print(
        f"{name}: ADD-S {shares[0]} of {targets}, ADD {shares[1]} of {targets}, "
        f"{wrong} wrong answers"
    )


def print_frame(
    frame: Frame, found: Sequence[TrackedDetection], spent: float, model: ObjectModel
) -> None:
    """One line: what was found, by which way, and how far from the nearest target."""
    parts = []
    for each in found:
        errors = [
            min(
                error(each.pose_cam_obj, t.pose_cam_obj, model.mesh.vertices) for t in frame.targets
            )
            for error in (add_s, add)
        ]
        way = "tracked" if each.tracked else "detected"
        shown = ", ".join(f"{1000 * error:.1f}" for error in errors)
        parts.append(f"#{each.track} {way} {each.score:.2f} ADD-S, ADD {shown} mm")
    print(f"{frame.key} {spent:6.1f} ms  " + "; ".join(parts))


if __name__ == "__main__":
    main()
