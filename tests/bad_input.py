"""Cases of bad input: what reads it, and words of HLP's own error that names what is expected."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hlp.errors import HlpError

Case = tuple[Callable[[Path], object], str]
DEEP = "[" * 100_000


def written(path: Path, content: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def of_file(read: Callable[[Path], object], name: str, content: str | bytes) -> Any:
    """A reader of one file with some content."""
    return lambda folder: read(written(folder / name, content))


def pixels(read: Callable[[Path], object], name: str, image: np.ndarray) -> Any:
    """A reader of an image."""
    return of_file(read, name, cv2.imencode(Path(name).suffix, image)[1].tobytes())


def check(case: Case, folder: Path) -> None:
    """It must be an error of our own, in few words, with these among them."""
    read, words = case
    with pytest.raises(HlpError) as caught:
        read(folder)
    assert words in str(caught.value)
    assert len(str(caught.value)) < 600
