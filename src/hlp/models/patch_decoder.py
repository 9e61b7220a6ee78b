"""The autoencoder's second half, which turns a feature back into a patch, and its file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor, nn

from hlp.errors import DataError
from hlp.files import replaced
from hlp.models.encoder import RESOLUTION

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
