"""The strided network that the autoencoder and the contrastive encoder train."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from pytorch_lightning.utilities.types import OptimizerLRScheduler
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor, nn
from torch.optim import Optimizer
from torch.optim.lr_scheduler import OneCycleLR

from hlp.errors import DataError
from hlp.files import replaced
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


DECODER = "decoder.safetensors"


class PatchDecoder(nn.Module):
    """The mirror image of `PatchEncoder`: (n, dimension) → (n, 4, 32, 32) in [-1, 1].

    `widths` are the encoder's.
    """

    def __init__(self, widths: Sequence[int], dimension: int) -> None:
        super().__init__()
        self.side = RESOLUTION // 2 ** len(widths)
        back = tuple(widths)[::-1]
        self.expand = nn.Linear(dimension, back[0] * self.side**2)
        layers: list[nn.Module] = []
        for width, following in zip(back, (*back[1:], 4), strict=True):
            layers += [nn.ConvTranspose2d(width, following, 4, stride=2, padding=1)]
            layers += [nn.LeakyReLU(0.1, inplace=True)]
        self.convolutions = nn.Sequential(*layers[:-1], nn.Tanh())

    def forward(self, features: Tensor) -> Tensor:
        """Patches (n, 4, 32, 32)."""
        start = self.expand(features).unflatten(1, (-1, self.side, self.side))
        return torch.as_tensor(self.convolutions(start))


def save_decoder(decoder: PatchDecoder, folder: Path) -> None:
    """Write the decoder's weights (`decoder.safetensors`)."""
    weights = {name: value.contiguous() for name, value in decoder.state_dict().items()}
    with replaced(folder / DECODER) as stream:
        stream.write(save(weights))


def decode(
    folder: Path, widths: Sequence[int], features: Float[np.ndarray, "n d"]
) -> Float[np.ndarray, "n p p 4"] | None:
    """Patches, channels last, that the decoder in a folder makes of features; None without one.

    `widths` are the encoder's. Raises DataError for a damaged file.
    """
    path = folder / DECODER
    if not path.is_file():
        return None
    decoder = PatchDecoder(widths, features.shape[1])
    try:
        decoder.load_state_dict(load_file(path))
    except (SafetensorError, RuntimeError) as error:
        raise DataError(f"{path} is no decoder of this encoder ({error})") from error
    with torch.inference_mode():
        images = decoder.eval()(torch.from_numpy(np.asarray(features, dtype=np.float32)))
    return np.asarray(images.permute(0, 2, 3, 1).numpy())


def one_cycle(
    optimizer: Optimizer, learning_rate: float, steps: float, rise: float
) -> OptimizerLRScheduler:
    """The optimizer with one cycle over all `steps`: up to the rate, then down to nothing.

    `rise` is the share of the steps in which the rate rises.
    """
    if rise * int(steps) == 1.0:  # OneCycleLR would divide by the length of the rise, 0
        rise *= 2.0
    schedule = OneCycleLR(optimizer, learning_rate, total_steps=int(steps), pct_start=rise)
    return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}
