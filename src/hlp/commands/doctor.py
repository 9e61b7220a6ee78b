"""`hlp doctor`: what is wrong with a data set, frames, learnt objects or this machine."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.commands import composing, own_arguments

if TYPE_CHECKING:
    from hlp.checks import Finding
    from hlp.method.detector import Detector

_FRAMES = ("rgb", "depth", "intrinsics")


def command(arguments: Sequence[str]) -> None:
    """Print what is wrong; exits with 1 if anything is."""
    if composing.HELP & set(arguments):
        print(DOCTOR_HELP)
        return
    own_arguments.call(lambda: _examine(arguments))


def _examine(arguments: Sequence[str]) -> None:
    from hlp.data.frame_paths import with_frames

    given = with_frames(own_arguments.split_arguments(arguments))
    from hlp.data.own_frames import FrameFiles

    known = [*own_arguments.field_names(FrameFiles), "data", "learnt", "output", "work"]
    own_arguments.check_known(given, known, "doctor")
    from hlp.checks.machine import describe_machine
    from hlp.runs import doctor
    from hlp.runs.learnt_cache import cache_folder, find_learnt

    cache = cache_folder(given.get("work"))
    findings: list[Finding] = doctor.examine_machine(cache)
    print("machine   " + "\n          ".join(describe_machine()))
    detector: Detector | None = None
    if "learnt" in given:
        folder = find_learnt(given["learnt"], cache)
        detector, more = doctor.examine_learnt(folder)
        print(f"learnt    {folder}")
        findings += more
    if "data" in given:
        output = Path(given["output"]).expanduser() if "output" in given else None
        print(f"data      {given['data']}")
        findings += doctor.examine_dataset(Path(given["data"]).expanduser(), output)
        if output is not None:
            print(f"pictures  {output} (objects at their true poses)")
    if any(key in given for key in _FRAMES):
        findings += _examine_own(given, detector)
    print("\n".join(doctor.describe(findings)))
    if findings:
        sys.exit(1)


def _examine_own(given: Mapping[str, str], detector: Detector | None) -> list[Finding]:
    from hlp.data.own_frames import FrameFiles, OwnFrames
    from hlp.runs import doctor

    frames = OwnFrames(own_arguments.read_group(FrameFiles, given))
    print(f"frames    {given.get('rgb')}")
    return doctor.examine_own(frames, detector)


DOCTOR_HELP = """\
usage: hlp doctor [data=FOLDER] [learnt=FOLDER|NAME]
                  [rgb=… depth=… intrinsics=…]

Says what is wrong, and exits with 1 if anything is.

  nothing   this machine: libraries, threads, disk
  data      a data set in BOP's layout: files, intrinsics, registration of
            depth, and whether the objects at their true poses agree with the
            depth; if not, which fault explains it (unit of depth, poses or
            meshes; transposed or inverted poses; axes; focal length; shift)
  learnt    what `hlp learn` made
  rgb, depth, intrinsics or frames (and the other keys of `hlp predict`)
            your own frames; with learnt objects that are in view also faults
            that keep them from being found, or from fitting well: unit of
            depth or mesh, focal length, exchanged colours, shifted depth

  output    folder for pictures of the data set's objects at their true poses

hlp doctor                                 this machine
hlp doctor data=/path/to/lm output=look/
hlp doctor learnt=bracket rgb=rgb/ depth=depth/ intrinsics=camera.json"""
