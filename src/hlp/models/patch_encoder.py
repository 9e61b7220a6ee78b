"""The strided network that the autoencoder and the contrastive encoder train."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from hlp.models.encoder import RESOLUTION


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

    @property
    def layers(self) -> list[nn.Module]:
        """The layers in their order."""
        return [*self.convolutions, nn.Flatten(), self.dense]
