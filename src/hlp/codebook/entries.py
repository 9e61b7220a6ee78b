"""Entries of a codebook: what is stored with each feature, and the file on disk."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge
from jaxtyping import Float

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
    """Write a codebook as one .npz file."""
    np.savez(
        folder / "codebook.npz",
        object_id=codebook.object_id,
        features=codebook.features,
        rotations=codebook.rotations_cam_obj,
        points=codebook.points_obj,
        feature_scale=codebook.feature_scale,
    )


def load_codebook(folder: Path) -> Codebook:
    """Read what `save_codebook` wrote. Raises MissingFileError, or DataError for a damaged file."""
    stored = read_npz(folder / "codebook.npz")
    return Codebook(
        int(stored["object_id"]),
        stored["features"],
        stored["rotations"],
        stored["points"],
        float(stored["feature_scale"]),
    )
