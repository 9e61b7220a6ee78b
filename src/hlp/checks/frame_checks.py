"""Whether frames can be read, and what is seen in them alone, without poses or a search."""

from collections.abc import Callable, Sequence

from hlp.checks.camera import check_depth_scale, check_intrinsics, check_object_size
from hlp.checks.finding import Finding
from hlp.checks.registration import check_registration
from hlp.errors import HlpError
from hlp.records import Frame, ObjectModel


def read_frames(
    load: Callable[[str], Frame], keys: Sequence[str], kept: int
) -> tuple[list[Frame], list[Finding]]:
    """Some of the frames, spread evenly, and what is wrong with any of them.

    Every frame is decoded; at most about `kept` are returned.
    """
    every = max(len(keys) // max(kept, 1), 1)
    frames, findings = [], []
    for number, key in enumerate(keys):
        try:
            frame = load(key)
        except HlpError as error:
            findings.append(Finding("files", key, str(error), "Copy or download it again"))
            continue
        if number % every == 0:
            frames.append(frame)
    return frames, findings


def check_frames(frames: Sequence[Frame], models: Sequence[ObjectModel]) -> list[Finding]:
    """The quick checks: a tenth of a second for a frame. `models` are looked for, or none."""
    if not frames:
        return []
    return [
        *check_intrinsics(frames[0]),
        *check_depth_scale(frames[0], models),
        *check_object_size(models),
        *check_registration(frames),
    ]
