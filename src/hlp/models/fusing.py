"""Trained networks made ready for finding."""

import copy
from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval


def on_device_of(network: nn.Module, images: Tensor) -> Tensor:
    """Images as a fused network takes them: on its device, bfloat16, the channels last."""
    device = next(network.parameters()).device
    low = images.to(device, torch.bfloat16)
    return low.contiguous(memory_format=torch.channels_last)


def fuse_for_inference(layers: Iterable[nn.Module], device: str) -> nn.Sequential:
    """The layers for finding on a device: batch norm within convolutions, no dropout, bfloat16.

    Closer to the network in single precision than autocast is, and faster: what autocast rounds
    after every step is rounded once a layer. The layers themselves stay as they were.
    """
    found: list[nn.Module] = []
    for layer in layers:
        each = copy.deepcopy(layer).float().eval()
        if isinstance(each, nn.BatchNorm2d) and isinstance(found[-1], nn.Conv2d):
            found[-1] = fuse_conv_bn_eval(found[-1], each)
        elif not isinstance(each, nn.Dropout):
            found.append(each)
    network = nn.Sequential(*found).requires_grad_(False)
    return network.to(device, torch.bfloat16, memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]
