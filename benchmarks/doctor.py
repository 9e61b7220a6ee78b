"""How often doctor and predict warn of healthy frames.

    python benchmarks/doctor.py learnt/cup ../shared/data/cup [EVERY]

Every frame of a data set in BOP's layout, or each EVERY-th, is examined alone, and each three that
follow each other together, as `hlp predict` and `hlp doctor` examine them: intrinsics, units,
registration in full, colours and corrections at what is found. Every finding is printed.
"""

import argparse
from pathlib import Path

from hlp import Detector
from hlp.checks.corrections import check_gains
from hlp.checks.frame_checks import check_first_frame
from hlp.checks.known_objects import find_answers, known_gains
from hlp.checks.registration import check_registration
from hlp.data.bop import BopSettings


def main() -> None:
    """Examine and count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("learnt", type=Path, help="folder of learnt objects")
    parser.add_argument("data", type=Path, help="a data set")
    parser.add_argument("every", type=int, nargs="?", default=1)
    given = parser.parse_args()
    detector = Detector.load(given.learnt)
    models = list(detector.models.values())
    source = BopSettings(root=str(given.data)).build().frames
    frames = [source.load(key) for key in source.keys[:: given.every]]
    gains = []
    for frame in frames:
        answers = find_answers(detector, detector.objects, {}, frame)
        gains.append(known_gains(detector, frame, answers))
    for length in (1, 3):
        alarms, groups = 0, [range(i, i + length) for i in range(len(frames) - length + 1)]
        for group in groups:
            shown = [frames[place] for place in group]
            found = [
                *check_first_frame(shown[0], models),
                *check_registration(shown),
                *check_registration(shown, whole=True),
                *check_gains([gains[place] for place in group]),
            ]
            alarms += bool(found)
            for finding in found:
                print(f"  {shown[0].key}, {length} frames: {finding}", flush=True)
        name = given.data.name
        print(f"{name}: {alarms} of {len(groups)} calls with {length} frames", flush=True)


if __name__ == "__main__":
    main()
