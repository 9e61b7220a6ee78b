"""What a local encoder sees of a patch: four channels at 32 × 32, chosen by name."""

from typing import Literal, get_args

import numpy as np
import torch
from torch import Tensor

from hlp.models.normals import normals_and_depth
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
        return _normals_and_depth(depth, valid)
    raise ValueError(
        f"unknown encoder input '{kind}': choose one of {', '.join(get_args(EncoderInput))}"
    )


def patch_input(patches: LocalPatches, kind: str) -> Tensor:
    """`encoder_input` of cut patches."""
    color = None
    if patches.color.shape[-1] and sees_color(kind):
        color = torch.from_numpy(patches.color).permute(0, 3, 1, 2).float() / 255.0
    return encoder_input(color, *patch_depth(patches), kind)


def patch_depth(patches: LocalPatches) -> tuple[Tensor, Tensor]:
    """Depth and valid (n, p, p) of cut patches."""
    return torch.from_numpy(patches.depth).float(), torch.from_numpy(patches.valid)


def sees_color(kind: str) -> bool:
    """Whether an input of this kind needs patches with colour."""
    return kind == "rgbd"


def surface_normals(depth: Tensor, valid: Tensor) -> Tensor:
    """Unit normals (n, 3, p, p) of the patch's depth, 0 where it is not valid."""
    return _normals_and_depth(depth, valid)[:, :3]


def _normals_and_depth(depth: Tensor, valid: Tensor) -> Tensor:
    """Channels (n, 4, p, p), the channels last in memory, as the network wants them."""
    out = np.empty((*depth.shape, 4), dtype=np.float32)
    normals_and_depth(depth.cpu().numpy(), valid.cpu().numpy(), out)
    return torch.from_numpy(out).permute(0, 3, 1, 2).to(depth.device)


def empty_features(dimension: int) -> np.ndarray:
    """Features of no patch at all."""
    return np.zeros((0, dimension), dtype=np.float32)
