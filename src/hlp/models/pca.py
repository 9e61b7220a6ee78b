"""Principal components of surface normals: a local feature without any training of weights."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from hlp.models.encoder_input import empty_features, patch_depth, surface_normals
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
        depth, valid = patch_depth(patches)
        flat = _averaged_normals(depth, valid, self.cells)
        return np.asarray((flat - self.mean) @ self.components.T, dtype=np.float32)


def pca_components(cells: int) -> int:
    """Largest dimension of a feature: three coordinates of the normal in each of cells² cells."""
    return 3 * cells**2


def fit_pca(depth: Tensor, valid: Tensor, settings: PcaSettings) -> PcaEncoder:
    """Principal components of patches' normals; depth and valid (n, p, p).

    A feature has `settings.dimension` numbers, or `pca_components` where that is less.
    """
    flat = _averaged_normals(depth, valid, settings.cells)
    mean = flat.mean(axis=0)
    covariance = np.cov((flat - mean).T)
    _, vectors = np.linalg.eigh(covariance)
    dimension = min(settings.dimension, pca_components(settings.cells))
    return PcaEncoder(mean, vectors[:, ::-1][:, :dimension].T.astype(np.float32), settings.cells)


def _averaged_normals(depth: Tensor, valid: Tensor, cells: int) -> Float[np.ndarray, "n f"]:
    normals = surface_normals(depth, valid)
    return np.asarray(functional.adaptive_avg_pool2d(normals, cells).flatten(1).numpy())
