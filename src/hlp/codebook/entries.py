"""Entries of a codebook: what is stored with each feature, and the file on disk."""

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge
from jaxtyping import Float

from hlp.errors import DataError
from hlp.files import read_npz
from hlp.geometry import allocentric_to_egocentric
from hlp.records import Codebook
from hlp.settings import Doc, Settings


@dataclass(frozen=True)
class EntrySettings(Settings):
    """Entries of an object's codebook."""

    patches_per_view: Annotated[int, Ge(1), Doc("local patches drawn from every view (D)")] = 16


def make_codebook(
    object_id: int,
    features: Float[np.ndarray, "m d"],
    points_cam: Float[np.ndarray, "m 3"],
    poses_cam_obj: Float[np.ndarray, "m 4 4"],
    feature_scale: float,
) -> Codebook:
    """Make a codebook: features, each with what it votes for.

    `points_cam` are the patch centres in camera coordinates of their view, `poses_cam_obj` the
    view's pose. The rotation is stored relative to the patch's viewing ray, so that detection can
    transfer it to any other ray.
    """
    rotations = poses_cam_obj[:, :3, :3]
    along_axis = np.swapaxes(allocentric_to_egocentric(points_cam), -1, -2) @ rotations
    from_view = points_cam - poses_cam_obj[:, :3, 3]
    points_obj = np.einsum("mij,mi->mj", rotations, from_view)
    return Codebook(
        object_id,
        features.astype(np.float32),
        along_axis.astype(np.float32),
        points_obj.astype(np.float32),
        feature_scale,
    )


def save_codebook(folder: Path, codebook: Codebook) -> None:
    """Write a codebook as one .npz file.

    Of each number of a feature, the byte with sign and exponent is compressed to less than half;
    the other three are random bits.
    """
    bits = np.ascontiguousarray(codebook.features, dtype=np.float32).view(np.uint32)
    exponents = zlib.compress((bits >> 24).astype(np.uint8).tobytes(), level=1)
    np.savez(
        folder / "codebook.npz",
        object_id=codebook.object_id,
        low=(bits & 0xFFFF).astype(np.uint16),
        middle=(bits >> 16 & 0xFF).astype(np.uint8),
        exponents=np.frombuffer(exponents, np.uint8),
        rotations=codebook.rotations_cam_obj,
        points=codebook.points_obj,
        feature_scale=codebook.feature_scale,
    )


def load_codebook(folder: Path) -> Codebook:
    """Read what `save_codebook` wrote. Raises MissingFileError, or DataError for a damaged file."""
    path = folder / "codebook.npz"
    stored = read_npz(path)
    try:
        exponents = np.frombuffer(zlib.decompress(stored["exponents"].tobytes()), np.uint8)
        bits = exponents.reshape(stored["low"].shape).astype(np.uint32)
        bits <<= 8
        bits |= stored["middle"]
        bits <<= 16
        bits |= stored["low"]
        return Codebook(
            int(stored["object_id"]),
            bits.view(np.float32),
            stored["rotations"],
            stored["points"],
            float(stored["feature_scale"]),
        )
    except (KeyError, ValueError, zlib.error) as error:
        raise DataError(f"{path} is damaged ({error!r}): learn the object again") from error
