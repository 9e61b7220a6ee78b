"""The strided encoder shared by the CAE and the contrastive encoder, and its inference."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from hlp.models.encoder_input import empty_features, encoder_input, patch_tensors
from hlp.records import LocalPatches

RESOLUTION = 32  # px of a patch's side (paper, section 3.2)
_CHUNK = 512


class Encoder(Protocol):
    """Turns local patches into features whose Euclidean distances mean likeness."""

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

    def __init__(self, network: PatchEncoder, kind: str, unit_length: bool) -> None:
        network.eval()
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.network = network
        self.kind = kind
        self.unit_length = unit_length

    @torch.inference_mode()
    def encode(self, patches: LocalPatches) -> Float[np.ndarray, "n d"]:
        """Features (n, d) float32 of n patches."""
        if len(patches) == 0:
            return empty_features(self.network.dense.out_features)
        features = []
        tensors = (torch.split(values, _CHUNK) for values in patch_tensors(patches))
        for color, depth, valid in zip(*tensors, strict=True):
            images = encoder_input(color, depth, valid, self.kind)
            with torch.autocast("cpu", dtype=torch.bfloat16):
                code = self.network(images.contiguous(memory_format=torch.channels_last))
            features.append(code.float())
        stacked = torch.cat(features)
        if self.unit_length:
            stacked = functional.normalize(stacked, dim=1)
        return np.asarray(stacked.numpy())
