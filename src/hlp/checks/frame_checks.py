"""Whether frames can be read, and what is seen in them alone, without poses or a search."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from hlp.checks.camera import check_depth_scale, check_intrinsics, check_object_size
from hlp.checks.finding import Finding
from hlp.checks.registration import check_registration
from hlp.errors import HlpError
from hlp.records import Frame, ObjectModel

_SHOWN = 3  # findings of one kind
_ADVICE = {"files": "Copy or download it again", "values": "Mend it, or leave this frame out"}


def read_frames(
    load: Callable[[str], Frame],
    keys: Sequence[str],
    kept: int,
    read: Callable[[str], Frame] | None = None,
) -> tuple[list[Frame], list[Finding]]:
    """Some of the frames, spread evenly, and what is wrong with any of them.

    Every frame is decoded; at most about `kept` are returned. `read` decodes without asking whether
    the values make sense: a frame that only `load` refuses is returned too, with a finding of kind
    "values". Of many findings of a kind, the first ones are returned, and how many more there are.
    """
    every = max(len(keys) // max(kept, 1), 1)
    frames, wrong = [], dict[str, list[Finding]]()
    for number, key in enumerate(keys):
        try:
            frame = load(key)
        except HlpError as refusal:
            try:
                frame, kind, error = _again(read, key, refusal), "values", refusal
            except HlpError as failure:
                kind, error = "files", failure
            findings = wrong.setdefault(kind, [])
            findings.append(Finding(kind, key, str(error), _ADVICE[kind]))
            if kind == "files":
                continue
        if number % every == 0:
            frames.append(frame)
    return frames, [each for findings in wrong.values() for each in _first(findings)]


def _again(read: Callable[[str], Frame] | None, key: str, refusal: HlpError) -> Frame:
    if read is None:
        raise refusal
    return read(key)


def _first(findings: Sequence[Finding]) -> list[Finding]:
    """The first findings of a kind; what is left out is counted in the last one."""
    left = len(findings) - _SHOWN
    if left <= 0:
        return list(findings)
    last = findings[_SHOWN - 1]
    return [*findings[: _SHOWN - 1], replace(last, where=f"{last.where} (and {left} more frames)")]


def check_frames(frames: Sequence[Frame], models: Sequence[ObjectModel]) -> list[Finding]:
    """The quick checks: a tenth of a second for a frame. `models` are looked for, or none."""
    if not frames:
        return []
    return [*check_first_frame(frames[0], models), *check_registration(frames)]


def check_first_frame(frame: Frame, models: Sequence[ObjectModel]) -> list[Finding]:
    """What one frame is enough for: intrinsics, and the units of depth and meshes."""
    return [
        *check_intrinsics(frame),
        *check_object_size(models),
        *check_depth_scale(frame, models),
    ]
