"""Networks as training leaves them, and what the classifier is shown."""

import numpy as np
import torch
from torch import nn


def trained(network: nn.Module, size: int, channels: int = 4) -> nn.Module:
    """The network after its batch norms have seen images of some size, still in training."""
    gen = torch.Generator().manual_seed(0)
    for scale in (0.5, 1.0, 2.0):
        network.train()(torch.randn((16, channels, size, size), generator=gen) * scale)
    return network


def random_levels(count: int, channels: int, seed: int = 0) -> np.ndarray:
    """Windows (n, 64, 64, c) as the classifier is given them: levels of 1 to 255."""
    rng = np.random.default_rng(seed)
    return rng.integers(1, 256, (count, 64, 64, channels)).astype(np.uint8)


def scaled(levels: np.ndarray) -> torch.Tensor:
    """Levels as training has them: (n, c, h, w) in [-1, 1]."""
    images = torch.from_numpy(levels).permute(0, 3, 1, 2).float()
    return torch.cat([images[:, :3] / 127.5 - 1, (images[:, 3:] - 128) / 127], dim=1)
