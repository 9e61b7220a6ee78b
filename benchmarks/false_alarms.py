"""How often learnt objects are found in images that do not show them.

    python benchmarks/false_alarms.py learnt/cup ../shared/data/mustard ../shared/data/ycbv

Every object of a learnt folder (`Detector.learn`) is searched in all frames of data sets in BOP's
layout. None of them may show it. Printed are, for each data set, the searches, the detections
with a score of at least a half, and the time of a search.
"""

import argparse
import time
from pathlib import Path

from hlp import Detector
from hlp.data.bop import BopSettings


def main() -> None:
    """Search and count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("learnt", type=Path, help="folder of learnt objects")
    parser.add_argument("data", type=Path, nargs="+", help="data sets without these objects")
    given = parser.parse_args()
    detector = Detector.load(given.learnt)
    detector.warm_up()
    for root in given.data:
        frames = BopSettings(root=str(root)).build().frames
        alarms, begun = [], time.perf_counter()
        for key in frames.keys:
            frame = frames.load(key)
            found = detector.detect(frame.rgb, frame.depth, frame.camera_matrix)
            alarms += [f"{key} {each.object} {each.score:.2f}" for each in found]
        searches = len(frames.keys) * len(detector.objects)
        spent = (time.perf_counter() - begun) / searches
        print(f"{root.name}: {len(alarms)} of {searches}, {1000 * spent:.0f} ms each", flush=True)
        for each in alarms:
            print(f"  {each}", flush=True)


if __name__ == "__main__":
    main()
