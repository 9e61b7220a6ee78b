"""Input of a local encoder in training: from batches of tensors to channels of patches."""

import torch
from torch import Tensor

from hlp.models.encoder import normals_with_depth, sees_color


def encoder_input(color: Tensor | None, depth: Tensor, valid: Tensor, kind: str) -> Tensor:
    """Channels (n, 4, p, p) in [-1, 1] of colour (n, 3, p, p) in 0…1 and depth, valid (n, p, p).

    The kinds are those of `patch_input`. Raises ValueError for another kind, and for `rgbd` without
    colour.
    """
    if sees_color(kind):
        if color is None:
            raise ValueError("the encoder's input 'rgbd' needs patches with colour")
        return torch.cat([color * 2.0 - 1.0, depth[:, None]], dim=1)
    images = normals_with_depth(depth.cpu().numpy(), valid.cpu().numpy())
    # Channels stay last in memory, which is fastest for the network.
    return torch.from_numpy(images).permute(0, 3, 1, 2).to(depth.device)
