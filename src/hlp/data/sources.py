"""Interface of the sources of RGB-D frames, and hashes of files by their content."""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool

from hlp.records import Frame, Target

_CHUNK = 1 << 20


class FrameSource(Protocol):
    """An ordered set of RGB-D frames, loaded one at a time.

    `keys` are the frames' `Frame.key`, in order and unique; they are known without decoding images.
    """

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the frames, in order."""
        ...

    def load(self, key: str) -> Frame:
        """Decode one frame. Raises KeyError for an unknown key, ValueError for a broken file."""
        ...

    def identity(self) -> str:
        """Hash of all content that the frames are made from."""
        ...

    def __len__(self) -> int:
        """Number of frames."""
        ...


@runtime_checkable
class VisibleMasks(Protocol):
    """Frames with masks of the targets' visible pixels."""

    def visible_mask(self, frame: Frame, target: Target) -> Bool[np.ndarray, "h w"] | None:
        """Pixels that show the target, which is one of the frame's; None if not known."""
        ...


def annotated_mask(
    source: FrameSource, frame: Frame, target: Target
) -> Bool[np.ndarray, "h w"] | None:
    """The data set's own mask of the pixels that show a target; None where it has none."""
    return source.visible_mask(frame, target) if isinstance(source, VisibleMasks) else None


def content_hash(files: Iterable[Path], extra: str = "") -> str:
    """BLAKE2b over the bytes of the files in the given order, and `extra` (32 hex digits).

    File names are hashed without their folders, so that a data set can be moved. Raises OSError
    for a file that cannot be read.
    """
    digest = hashlib.blake2b(extra.encode(), digest_size=16)
    for file in files:
        digest.update(f"\0{file.name}\0{file.stat().st_size}\0".encode())
        with file.open("rb") as stream:
            while chunk := stream.read(_CHUNK):
                digest.update(chunk)
    return digest.hexdigest()
