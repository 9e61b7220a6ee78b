"""One file of arrays for each frame, written whole or not at all."""

from pathlib import Path

import numpy as np

from hlp.errors import DataError, MissingFileError
from hlp.files import read_npz, replaced


def write_arrays(folder: Path, key: str, arrays: dict[str, np.ndarray]) -> None:
    """Write `key`.npz. After a crash or on a full disk there is no partial file of that name."""
    with replaced(folder / f"{key}.npz") as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]


def read_arrays(folder: Path, key: str) -> dict[str, np.ndarray]:
    """Read what `write_arrays` wrote. Raises DataError naming a damaged file."""
    return read_npz(folder / f"{key}.npz")


def has_arrays(folder: Path, key: str) -> bool:
    """Whether `key`.npz is there and sound.

    After a crash of the machine a file that was written last can be empty or damaged.
    """
    try:
        read_arrays(folder, key)
    except (MissingFileError, DataError):
        return False
    return True
