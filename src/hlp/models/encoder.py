"""The strided encoder shared by the CAE and the contrastive encoder, and its inference."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from hlp.models.encoder_input import empty_features, patch_input, sees_color
from hlp.models.fusing import fuse_for_inference, on_device_of
from hlp.records import LocalPatches

RESOLUTION = 32  # px of a patch's side (paper, section 3.2)
_CHUNK = 512


class Encoder(Protocol):
    """Turns local patches into features whose Euclidean distances mean likeness.

    `sees_color`: whether it needs patches with colour.
    """

    sees_color: bool

    def encode(self, patches: LocalPatches) -> Float[np.ndarray, "n d"]:
        """Features (n, d) float32 of n patches."""


class PatchEncoder(nn.Module):
    """Strided convolutions and a dense layer: (n, 4, 32, 32) in [-1, 1] → (n, dimension)."""

    def __init__(self, widths: Sequence[int], dimension: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        previous = 4
        for width in widths:
            layers += [
                nn.Conv2d(previous, width, 3, stride=2, padding=1),
                nn.BatchNorm2d(width),
                nn.LeakyReLU(0.1, inplace=True),
            ]
            previous = width
        self.side = RESOLUTION // 2 ** len(widths)
        self.convolutions = nn.Sequential(*layers)
        self.dense = nn.Linear(previous * self.side**2, dimension)

    def forward(self, images: Tensor) -> Tensor:
        """Features (n, dimension)."""
        return torch.as_tensor(self.dense(self.convolutions(images).flatten(1)))


class NetworkEncoder:
    """`PatchEncoder` at work: one function, one precision, for views and scenes alike.

    `unit_length` divides features by their norm, as contrastive training assumes.
    """

    def __init__(
        self, network: PatchEncoder, kind: str, unit_length: bool, device: str = "cpu"
    ) -> None:
        self.network = fuse_for_inference(
            [*network.convolutions, nn.Flatten(), network.dense], device
        )
        self.dimension = network.dense.out_features
        self.kind = kind
        self.sees_color = sees_color(kind)
        self.unit_length = unit_length

    @torch.inference_mode()
    def encode(self, patches: LocalPatches) -> Float[np.ndarray, "n d"]:
        """Features (n, d) float32 of n patches."""
        if len(patches) == 0:
            return empty_features(self.dimension)
        images = patch_input(patches, self.kind)
        features = [self._features(part) for part in torch.split(images, _CHUNK)]
        return np.asarray(torch.cat(features).numpy())

    def _features(self, images: Tensor) -> Tensor:
        code = torch.as_tensor(self.network(on_device_of(self.network, images))).float().cpu()
        return functional.normalize(code, dim=1) if self.unit_length else code
