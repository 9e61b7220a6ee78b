"""What a local encoder sees of a patch: four channels at 32 × 32, chosen by name."""

from typing import Literal, get_args

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from hlp.records import LocalPatches

EncoderInput = Literal["rgbd", "normals_depth"]


def encoder_input(color: Tensor | None, depth: Tensor, valid: Tensor, kind: str) -> Tensor:
    """Channels (n, 4, p, p) in [-1, 1] of colour (n, 3, p, p) in 0…1 and depth, valid (n, p, p).

    `rgbd` is the paper's (section 3.2); `normals_depth` sees shape only and needs no colour.
    Raises ValueError on another kind and where `rgbd` lacks colour.
    """
    if kind == "rgbd":
        if color is None:
            raise ValueError("the encoder's input 'rgbd' needs patches with colour")
        return torch.cat([color * 2.0 - 1.0, depth[:, None]], dim=1)
    if kind == "normals_depth":
        return torch.cat([surface_normals(depth, valid), depth[:, None]], dim=1)
    raise ValueError(
        f"unknown encoder input '{kind}': choose one of {', '.join(get_args(EncoderInput))}"
    )


def patch_tensors(patches: LocalPatches) -> tuple[Tensor, Tensor, Tensor]:
    """Colour (n, 3, p, p) in 0…1, depth and valid (n, p, p) of cut patches."""
    color = torch.from_numpy(patches.color).permute(0, 3, 1, 2).float() / 255.0
    return color, torch.from_numpy(patches.depth).float(), torch.from_numpy(patches.valid)


def surface_normals(depth: Tensor, valid: Tensor) -> Tensor:
    """Unit normals (n, 3, p, p) of the patch's depth, 0 where it is not valid.

    Depth is smoothed over the valid pixels first: at a patch's pitch of 1–3 mm a Kinect's noise
    and quantisation are as large as the differences.
    """
    weight = valid.float()[:, None]
    smooth = depth[:, None] * weight
    for _ in range(2):
        smooth = functional.avg_pool2d(smooth, 3, stride=1, padding=1)
        weight = functional.avg_pool2d(weight, 3, stride=1, padding=1)
    surface = smooth / weight.clamp(min=1e-3)
    surface = torch.where(weight > 0.05, surface, depth[:, None])
    pitch = 2.0 / depth.shape[-1]  # depth and pitch are both in halves of the metric size
    padded = functional.pad(surface, (1, 1, 1, 1), mode="replicate")
    dx = (padded[:, :, 1:-1, 2:] - padded[:, :, 1:-1, :-2]) / (2.0 * pitch)
    dy = (padded[:, :, 2:, 1:-1] - padded[:, :, :-2, 1:-1]) / (2.0 * pitch)
    # Spelled out: torch's own normalisation takes longer than all the rest of this function.
    length = (dx * dx + dy * dy + 1.0).sqrt()
    return torch.cat([dx, dy, -torch.ones_like(dx)], dim=1) * (valid[:, None] / length)


def empty_features(dimension: int) -> np.ndarray:
    """Features of no patch at all."""
    return np.zeros((0, dimension), dtype=np.float32)
