"""One file of arrays a frame, written at once or not at all."""

import zipfile
import zlib
from pathlib import Path

import numpy as np

from hlp.files import replaced


def write_arrays(folder: Path, key: str, arrays: dict[str, np.ndarray]) -> None:
    """Write `key`.npz; a crash or a full disk leaves no half file under that name."""
    with replaced(folder / f"{key}.npz") as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]


def read_arrays(folder: Path, key: str) -> dict[str, np.ndarray]:
    """Read what `write_arrays` wrote. Raises ValueError naming a file that is damaged."""
    path = folder / f"{key}.npz"
    try:
        with np.load(path) as stored:
            return dict(stored)
    except FileNotFoundError:
        raise
    except (ValueError, EOFError, OSError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(
            f"{path} is damaged ({error}): delete its folder to make it anew"
        ) from error
