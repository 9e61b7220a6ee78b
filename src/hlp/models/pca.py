"""Principal components of surface normals: a local feature without any training of weights."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from hlp.models.encoder_input import empty_features, surface_normals
from hlp.records import LocalPatches


@dataclass(frozen=True)
class PcaSettings:
    """`dimension` of the feature; normals are averaged to `cells` × `cells` first."""

    name: str
    dimension: int
    cells: int


class PcaEncoder:
    """Projection of averaged normals on their principal components."""

    sees_color = False

    def __init__(
        self, mean: Float[np.ndarray, "f"], components: Float[np.ndarray, "d f"], cells: int
    ) -> None:
        self.mean = mean
        self.components = components
        self.cells = cells

    def encode(self, patches: LocalPatches) -> Float[np.ndarray, "n d"]:
        """Features (n, d) float32 of n patches."""
        if len(patches) == 0:
            return empty_features(len(self.components))
        flat = _averaged_normals(patches.depth, patches.valid, self.cells)
        return np.asarray((flat - self.mean) @ self.components.T, dtype=np.float32)


def pca_components(cells: int) -> int:
    """Largest dimension of a feature: three coordinates of the normal in each of cells² cells."""
    return 3 * cells**2


def fit_pca(
    depth: Float[np.ndarray, "n p p"], valid: Bool[np.ndarray, "n p p"], settings: PcaSettings
) -> PcaEncoder:
    """Principal components of patches' normals.

    A feature has `settings.dimension` numbers, or `pca_components` if that is less.
    """
    flat = _averaged_normals(depth, valid, settings.cells)
    mean = flat.mean(axis=0)
    covariance = np.cov((flat - mean).T)
    _, vectors = np.linalg.eigh(covariance)
    dimension = min(settings.dimension, pca_components(settings.cells))
    return PcaEncoder(mean, vectors[:, ::-1][:, :dimension].T.astype(np.float32), settings.cells)


def _averaged_normals(
    depth: Float[np.ndarray, "n p p"], valid: Bool[np.ndarray, "n p p"], cells: int
) -> Float32[np.ndarray, "n f"]:
    """Mean normal of each cell, one component after the other. Cells that do not divide overlap."""
    normals, size = surface_normals(depth, valid), depth.shape[1]
    first = np.arange(cells) * size // cells
    last = -(-np.arange(1, cells + 1) * size // cells)
    rows = np.stack([normals[:, a:b].mean(axis=1) for a, b in zip(first, last, strict=True)], 1)
    means = [rows[:, :, a:b].mean(axis=2) for a, b in zip(first, last, strict=True)]
    flat = np.stack(means, axis=2).transpose(0, 3, 1, 2)
    return np.ascontiguousarray(flat.reshape(len(depth), -1))
