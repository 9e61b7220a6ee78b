"""Images of windows by plain array operations: what the compiled cutting is compared with."""

import numpy as np
import torch
from torch import Tensor


def window_images(color: np.ndarray, code: np.ndarray, channels: str) -> Tensor:
    """Images (n, c, p, p) in [-1, 1] of cut windows, in the ranges the classifier is trained on."""
    image = torch.from_numpy(color).permute(0, 3, 1, 2).float() / 127.5 - 1
    if channels == "rgb":
        return image
    return torch.cat([image, (torch.from_numpy(code).float()[:, None] - 128) / 127], dim=1)
