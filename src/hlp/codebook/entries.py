"""Entries of a codebook: what is stored with each feature, and the file on disk."""

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Interval
from jaxtyping import Float, UInt32

from hlp.arrays import Features, Poses
from hlp.errors import DataError
from hlp.files import read_npz
from hlp.geometry import allocentric_to_egocentric
from hlp.records import Codebook
from hlp.settings import Count, Doc, Settings


@dataclass(frozen=True)
class EntrySettings(Settings):
    """Entries of an object's codebook."""

    patches_per_view: Annotated[Count, Doc("local patches drawn from every view (D)")] = 16
    min_plane_deviation: Annotated[
        float | None,
        Interval(ge=0, le=1),
        Doc("as of `patches.grid`: flat entries match nothing there (D); null: none (P: not said)"),
    ] = None


def make_codebook(
    object_id: int,
    features: Features,
    points_cam: Float[np.ndarray, "m 3"],
    poses_cam_obj: Poses,
    feature_scale: float,
) -> Codebook:
    """Make a codebook: features, each with what it votes for.

    `points_cam` are the patch centres in camera coordinates of their view, `poses_cam_obj` the
    view's pose. The rotation is stored relative to the patch's viewing ray, so that detection can
    transfer it to any other ray. Features are rounded to what the file keeps of them.
    """
    bits = _feature_bits(features)
    bits <<= 8
    rotations = poses_cam_obj[:, :3, :3]
    along_axis = np.swapaxes(allocentric_to_egocentric(points_cam), -1, -2) @ rotations
    from_view = points_cam - poses_cam_obj[:, :3, 3]
    points_obj = np.einsum("mij,mi->mj", rotations, from_view)
    places = along_axis.astype(np.float32), points_obj.astype(np.float32)
    return Codebook(object_id, bits.view(np.float32), *places, feature_scale)


def _feature_bits(features: Features) -> UInt32[np.ndarray, "m d"]:
    """The upper 24 bits of each number as float32, rounded: 16 of its 24 significant ones.

    The distances of features to each other differ by far more than what is lost, 1 part in 10⁵.
    """
    bits = np.ascontiguousarray(features, dtype=np.float32).view(np.uint32)
    rounded = bits >> 8  # changed in place: they are 40 MB
    rounded &= 1
    rounded += 0x7F
    rounded += bits
    rounded >>= 8
    return rounded


def save_codebook(folder: Path, codebook: Codebook) -> None:
    """Write a codebook as one .npz file, its features rounded as by `make_codebook`.

    Of each number of a feature, the byte with sign and exponent is compressed to less than half;
    the other two are random bits.
    """
    bits = _feature_bits(codebook.features)
    exponents = zlib.compress((bits >> 16).astype(np.uint8).tobytes(), level=1)
    np.savez(
        folder / "codebook.npz",
        object_id=codebook.object_id,
        low=(bits & 0xFF).astype(np.uint8),
        middle=(bits >> 8 & 0xFF).astype(np.uint8),
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
        shape = stored["low"].shape
        numbers = np.zeros((*shape, 4), np.uint8)  # the bytes of each, the lowest first
        numbers[..., 1], numbers[..., 2] = stored["low"], stored["middle"]
        numbers[..., 3] = exponents.reshape(shape)
        arrays = numbers.view("<f4")[..., 0], stored["rotations"], stored["points"]
        return Codebook(int(stored["object_id"]), *arrays, float(stored["feature_scale"]))
    except (KeyError, ValueError, zlib.error) as error:
        raise DataError(f"{path} is damaged ({error!r}): learn the object again") from error
