"""Principal components of surface normals: a local feature without a trained network."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Le
from jaxtyping import Float, Float32

from hlp.arrays import DepthPatches, Features, MaskPatches
from hlp.files import read_npz
from hlp.models.encoder import ENCODERS, EncoderTraining, normals_with_depth
from hlp.records import LocalPatches
from hlp.settings import Count, Doc, Settings, SettingsError

_FILE = "pca.npz"


@ENCODERS.register
@dataclass(frozen=True)
class PcaSettings(Settings):
    """Config group `encoder`: principal components of surface normals, a fast baseline (D)."""

    name: Literal["pca"] = "pca"
    dimension: Annotated[Count, Le(4096), Doc("length of the feature (P: 200)")] = 200
    cells: Annotated[Count, Le(32), Doc("normals are averaged to cells × cells first (D)")] = 12

    needs_frames: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Raise SettingsError if there are fewer components than `dimension`."""
        super().__post_init__()
        most = 3 * self.cells**2  # three coordinates of the normal in each of the cells
        if self.dimension > most:
            normals = f"{self.cells} × {self.cells} normals"
            problem = f"is {self.dimension}: {normals} have {most} components"
            raise SettingsError("dimension", problem)

    def train(self, training: EncoderTraining) -> None:
        """See `EncoderSettings.train`."""
        depth, valid = training.pair_patches()
        fitted = fit_pca(depth, valid, self)
        np.savez(training.folder / _FILE, mean=fitted.mean, components=fitted.components)

    def load(self, folder: Path, threads: int, device: str) -> "PcaEncoder":
        """See `EncoderSettings.load`."""
        stored = read_npz(folder / _FILE)
        return PcaEncoder(stored["mean"], stored["components"], self.cells)


@dataclass(frozen=True, eq=False)
class PcaEncoder:
    """Projection of averaged normals onto their principal components."""

    mean: Float[np.ndarray, "f"]
    components: Float[np.ndarray, "d f"]
    cells: int

    sees_color = False

    def encode(self, patches: LocalPatches) -> Features:
        """Features (n, d) float32 of n patches."""
        if len(patches) == 0:
            return np.zeros((0, len(self.components)), dtype=np.float32)
        flat = _averaged_normals(patches.depth, patches.valid, self.cells)
        # Not a product of matrices, whose sums BLAS orders by the number of patches: a feature must
        # not depend on the patches beside it.
        products = np.einsum("nf,df->nd", flat - self.mean, self.components)
        return np.asarray(products, dtype=np.float32)


def fit_pca(depth: DepthPatches, valid: MaskPatches, settings: PcaSettings) -> PcaEncoder:
    """Principal components of patches' normals."""
    flat = _averaged_normals(depth, valid, settings.cells)
    mean = flat.mean(axis=0)
    covariance = np.cov((flat - mean).T)
    _, vectors = np.linalg.eigh(covariance)
    components = vectors[:, ::-1][:, : settings.dimension].T.astype(np.float32)
    return PcaEncoder(mean, components, settings.cells)


def _averaged_normals(
    depth: DepthPatches, valid: MaskPatches, cells: int
) -> Float32[np.ndarray, "n f"]:
    """Mean normal of each cell, one component after another. Uneven cells overlap."""
    normals, size = normals_with_depth(depth, valid)[..., :3], depth.shape[1]
    first = np.arange(cells) * size // cells
    last = -(-np.arange(1, cells + 1) * size // cells)
    rows = np.stack([normals[:, a:b].mean(axis=1) for a, b in zip(first, last, strict=True)], 1)
    means = [rows[:, :, a:b].mean(axis=2) for a, b in zip(first, last, strict=True)]
    flat = np.stack(means, axis=2).transpose(0, 3, 1, 2)
    return np.ascontiguousarray(flat.reshape(len(depth), -1))
