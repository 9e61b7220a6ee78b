"""`hlp doctor`: what is wrong with a data set, frames, learnt objects or this machine."""

import sys
from collections.abc import Sequence
from pathlib import Path

from hlp.checks.machine import describe_machine
from hlp.commands import arguments as own
from hlp.data.frame_paths import with_frames
from hlp.data.own_frames import FrameFiles, OwnFrames
from hlp.runs import doctor as examining
from hlp.runs.learnt_cache import cache_folder, find_learnt

_FRAMES = {"rgb", "depth", "intrinsics"}


def doctor(arguments: Sequence[str]) -> None:
    """Print what is wrong; exits with 1 if anything is."""
    given = with_frames(own.split_arguments(arguments))
    known = [*own.field_names(FrameFiles), "data", "learnt", "output", "work"]
    own.check_known(given, known, "doctor")
    cache = cache_folder(given.get("work"))
    findings = examining.examine_machine(cache)
    print("machine   " + "\n          ".join(describe_machine()))
    detector = None
    if "learnt" in given:
        folder = find_learnt(given["learnt"], cache)
        detector, more = examining.examine_learnt(folder)
        print(f"learnt    {folder}")
        findings += more
    if "data" in given:
        output = Path(given["output"]).expanduser() if "output" in given else None
        print(f"data      {given['data']}")
        findings += examining.examine_dataset(Path(given["data"]).expanduser(), output)
        if output is not None:
            print(f"pictures  {output} (objects at their true poses)")
    if _FRAMES & given.keys():
        frames = OwnFrames(own.read_group(FrameFiles, given))
        print(f"frames    {given.get('rgb')}")
        findings += examining.examine_own(frames, detector)
    print("\n".join(examining.describe(findings)))
    if findings:
        sys.exit(1)
