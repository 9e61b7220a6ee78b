"""A network's first layer for images of 8-bit levels, so that they need not be scaled first.

For the range [-1, 1], colour has levels 0 … 255 and depth (`depth_code`) 1 … 255.
"""

import torch
from torch import Tensor, nn

LEVEL_ZERO = 128
LEVEL_STEP = 1.0 / 127.5
"""A level L stands for (L − 128) / 127.5."""
_COLORS, _KERNEL = 3, 5


def to_levels(images: Tensor) -> Tensor:
    """Images (n, c, p, p) in [-1, 1], c = 3 or 4, rounded to the values that levels stand for."""
    color = torch.round(images[:, :_COLORS] * 127.5 + 127.5)
    code = torch.round(images[:, _COLORS:] * 127.0) + LEVEL_ZERO
    return (torch.cat([color, code], dim=1).clamp(0, 255) - LEVEL_ZERO) * LEVEL_STEP


def side_by_side(images: Tensor) -> Tensor:
    """Images (n, 4c, p/2, p/2) with 2 × 2 neighbouring pixels of (n, c, p, p) as channels."""
    count, channels, size, _ = images.shape
    half = size // 2
    split = images.reshape(count, channels, half, 2, half, 2)
    return split.permute(0, 3, 5, 1, 2, 4).reshape(count, 4 * channels, half, half)


def levels_layer(layer: nn.Module) -> nn.Conv2d:
    """A 5 × 5 convolution of stride 2 as a 3 × 3 convolution over levels `side_by_side`.

    Integer kernels are fast with many channels and slow with four. The result is the same, except
    that the padding around the image is off by half a level of colour. Raises ValueError for
    another layer.
    """
    fits = isinstance(layer, nn.Conv2d) and layer.kernel_size == (_KERNEL, _KERNEL)
    if not (isinstance(layer, nn.Conv2d) and fits and layer.stride == (2, 2)):
        raise ValueError("images of levels need a 5 × 5 convolution of stride 2 as first layer")
    weights, bias = layer.weight.clone(), layer.bias
    assert bias is not None  # from the batch norm
    shift = weights[:, :_COLORS].sum(dim=(1, 2, 3)) * (0.5 * LEVEL_STEP)
    weights[:, _COLORS:] *= 127.5 / 127.0
    outputs, channels = weights.shape[:2]
    # Row 2i + a − 2 is row a mod 2 of the block i + a // 2 − 1; the sixth row and column are 0.
    padded = torch.zeros((outputs, channels, _KERNEL + 1, _KERNEL + 1))
    padded[:, :, :_KERNEL, :_KERNEL] = weights
    found = nn.Conv2d(4 * channels, outputs, 3, padding=1).requires_grad_(False)
    found.weight.copy_(side_by_side(padded))
    found.bias.copy_(bias + shift)  # type: ignore[union-attr]
    return found
