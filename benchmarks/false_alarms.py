"""How often learnt objects are found in images that do not show them, and how long that takes.

    python benchmarks/false_alarms.py learnt/cat ../shared/data/tables --shown ../shared/data/lm

Every object of a learnt folder (`Detector.learn`) is searched alone in frames of data sets in BOP's
layout, its number being unknown. Those of `--shown` show all of the objects, the others none of
them. Printed are, for each data set, the searches, those with a detection (a score of at least a
half), the median and mean CPU time of a search, and the median beside that of `--shown`.
"""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hlp import Detector
from hlp.arrays import spread
from hlp.data.bop import BopFrames
from hlp.data.bop_models import find_split


def main() -> None:
    """Search and count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("learnt", type=Path, help="folder of learnt objects")
    parser.add_argument("absent", type=Path, nargs="+", help="data sets without these objects")
    parser.add_argument("--shown", type=Path, help="a data set whose frames all show the objects")
    parser.add_argument("--frames", type=int, default=100, help="of a data set, at most")
    parser.add_argument("--threads", type=int, default=1)
    given = parser.parse_args()
    detector = Detector.load(given.learnt, threads=given.threads)
    detector.warm_up()
    first = None
    for root in ([given.shown] if given.shown else []) + given.absent:
        frames = BopFrames(root / find_split(root), None, (), every_frame=True)
        found, spent = search(detector, frames, spread(frames.keys, given.frames))
        first = float(np.median(spent)) if first is None else first
        print(
            f"{root.name}: {len(found)} of {len(spent)} searches with a detection, "
            f"{np.median(spent):.0f} ms of CPU each (mean {np.mean(spent):.0f}), "
            f"{np.median(spent) / first:.2f} times the first data set",
            flush=True,
        )
        if root != given.shown:
            print(*found, sep="\n", end="\n" if found else "")


def search(
    detector: Detector, frames: BopFrames, keys: Sequence[str]
) -> tuple[list[str], list[float]]:
    """What is found, a line for each search that finds anything, and milliseconds of each."""
    found: list[str] = []
    spent: list[float] = []
    for key in keys:
        frame = frames.load(key)
        for name in detector.objects:
            begun = time.process_time()
            answers = detector.detect(frame.rgb, frame.depth, frame.camera_matrix, [name])
            spent.append(1000 * (time.process_time() - begun))
            if answers:
                scores = " ".join(f"{each.score:.2f}" for each in answers)
                found.append(f"  {key} {name} {scores}")
    return found, spent


if __name__ == "__main__":
    main()
