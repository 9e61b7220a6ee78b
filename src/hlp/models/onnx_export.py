"""Writes trained networks as ONNX files: in single precision, and in 8-bit integers for detection.

Detection gives the networks 8-bit levels of colour: `to_levels` and `levels_layer` take them in.

Quantisation follows Jacob et al. 2018: weights symmetric for each output channel, activations for
each layer over the range on calibration images, sums in 32 bits. The last layer's output is not
quantised.
"""

import copy
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from jaxtyping import Shaped
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from hlp.models.network import INTEGER, SINGLE

_OPSET, _IR_VERSION = 17, 8  # supported by every ONNX Runtime since 2022
_MOST_STEPS = 2.0**30  # of a bias
_UNIT_STEP = 1.0 / 127.0  # of inputs in [-1, 1]


def export_network(layers: Iterable[nn.Module], sample: Tensor, stem: Path, levels: bool) -> None:
    """Write `stem`.onnx and `stem`.int8.onnx, whose input is `images` (n, p, p, c).

    `layers` are those of a trained network for images (n, c, p, p) in [-1, 1], or sequences of
    them; `sample` are such images from training. With `levels`, the input is uint8 as from
    `WindowImages`, otherwise float32 in [-1, 1]. The layers are not changed.
    """
    fused = fuse(layers)
    shape = (sample.shape[2], sample.shape[1])
    images = sample.detach().float().cpu().contiguous()
    if levels:
        fused[0] = levels_layer(fused[0])
        images = side_by_side(to_levels(images))
    for ending, integer in ((SINGLE, False), (INTEGER, True)):
        graph = _Graph(integer)
        start = graph.read_levels(*shape) if levels else graph.read_unit()
        with torch.inference_mode():
            graph.append(start, fused, images)
        onnx.save(graph.model(shape, levels), stem.with_name(stem.name + ending))


def fuse(layers: Iterable[nn.Module]) -> list[nn.Module]:
    """Copies of the layers for inference: batch norm fused into convolutions, no dropout."""
    found: list[nn.Module] = []
    for layer in nn.Sequential(*layers).modules():
        if isinstance(layer, nn.Sequential):
            continue
        copied = copy.deepcopy(layer).cpu().float().eval().requires_grad_(False)
        if isinstance(copied, nn.BatchNorm2d) and isinstance(found[-1], nn.Conv2d):
            found[-1] = fuse_conv_bn_eval(found[-1], copied)
        elif not isinstance(copied, nn.Dropout):
            found.append(copied)
    return found


class _Graph:
    """An ONNX graph that grows node by node; `integer` with quantised weights and activations."""

    def __init__(self, integer: bool) -> None:
        self.integer = integer
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []
        self.step = np.float32(_UNIT_STEP)  # of the activations that the next layer reads
        self.zero = np.uint8(LEVEL_ZERO)
        self.outputs = 0

    def read_levels(self, size: int, channels: int) -> str:
        """Images of levels, 2 × 2 pixels side by side as channels (see `side_by_side`)."""
        half = size // 2
        pairs = self._constant(np.array([-1, half, 2, half, 2, channels]))
        blocks = self._constant(np.array([-1, half, half, 4 * channels]))
        split = self._node("Reshape", "images", pairs)
        turned = self._node("Transpose", split, perm=[0, 1, 3, 2, 4, 5])
        self.step = np.float32(LEVEL_STEP)
        joined = self._node("Reshape", turned, blocks)
        return self._node("Transpose", self._dequantise(joined), perm=[0, 3, 1, 2])

    def read_unit(self) -> str:
        """Images in [-1, 1]."""
        images = self._rounded("images") if self.integer else "images"
        return self._node("Transpose", images, perm=[0, 3, 1, 2])

    def append(self, value: str, layers: Sequence[nn.Module], images: Tensor) -> None:
        """Append nodes of the layers, with the ranges of activations on `images`."""
        for layer, following in zip(layers, [*layers[1:], None], strict=True):
            images = layer(images)
            value = self._layer(layer, value)
            # Nothing is quantised before a ReLU, which would cut off part of the range.
            if self.integer and not isinstance(following, nn.ReLU | None):
                if not isinstance(layer, nn.Flatten):
                    self._set_range(images)
                value = self._rounded(value)
        self.nodes[-1].output[0] = "scores"
        self.outputs = images.shape[1]

    def model(self, shape: tuple[int, int], levels: bool) -> onnx.ModelProto:
        """The finished model for images of `shape` (p, c)."""
        size, channels = shape
        kind = TensorProto.UINT8 if levels else TensorProto.FLOAT
        images = helper.make_tensor_value_info("images", kind, ["n", size, size, channels])
        scores = helper.make_tensor_value_info("scores", TensorProto.FLOAT, ["n", self.outputs])
        graph = helper.make_graph(self.nodes, "hlp", [images], [scores], self.constants)
        opset = helper.make_opsetid("", _OPSET)
        model = helper.make_model(graph, opset_imports=[opset], ir_version=_IR_VERSION)
        onnx.checker.check_model(model)
        return model

    def _layer(self, layer: nn.Module, value: str) -> str:
        if isinstance(layer, nn.Conv2d):
            attributes = {
                "kernel_shape": layer.kernel_size,
                "strides": layer.stride,
                "pads": (*layer.padding, *layer.padding),
            }
            return self._node("Conv", value, *self._weights(layer), **attributes)
        if isinstance(layer, nn.Linear):
            return self._node("Gemm", value, *self._weights(layer), transB=1)
        if isinstance(layer, nn.LeakyReLU):
            return self._node("LeakyRelu", value, alpha=layer.negative_slope)
        if isinstance(layer, nn.ReLU):
            return self._node("Relu", value)
        if isinstance(layer, nn.Flatten):
            return self._node("Flatten", value)
        raise TypeError(f"no ONNX node is known for a layer {type(layer).__name__}")

    def _weights(self, layer: nn.Conv2d | nn.Linear) -> tuple[str, str]:
        weights = layer.weight.numpy()
        bias = np.zeros(len(weights), np.float32) if layer.bias is None else layer.bias.numpy()
        if not self.integer:
            return self._constant(weights), self._constant(bias)
        most = np.abs(weights.reshape(len(weights), -1)).max(axis=1)
        # A channel of weights near 0 keeps its bias, which must be a number of 32 bits of steps.
        least = np.maximum(np.abs(bias) / (self.step * _MOST_STEPS), 1e-9 / 127.0)
        steps = np.maximum(most / 127.0, least).astype(np.float32)
        by_row = steps.reshape(-1, *[1] * (weights.ndim - 1))
        sums = steps * self.step
        return (
            self._integers(np.rint(weights / by_row).astype(np.int8), steps),
            self._integers(np.rint(bias / sums).astype(np.int32), sums),
        )

    def _integers(self, values: Shaped[np.ndarray, "..."], steps: Shaped[np.ndarray, "n"]) -> str:
        zeros = np.zeros(len(steps), values.dtype)
        constants = [self._constant(array) for array in (values, steps, zeros)]
        return self._node("DequantizeLinear", *constants, axis=0)

    def _set_range(self, activations: Tensor) -> None:
        low, high = min(float(activations.min()), 0.0), max(float(activations.max()), 1e-6)
        self.step = np.float32((high - low) / 255.0)
        self.zero = np.uint8(round(-low / float(self.step)))

    def _rounded(self, value: str) -> str:
        """The value in whole steps."""
        step, zero = self._constant(self.step), self._constant(self.zero)
        return self._dequantise(self._node("QuantizeLinear", value, step, zero))

    def _dequantise(self, value: str) -> str:
        step, zero = self._constant(self.step), self._constant(self.zero)
        return self._node("DequantizeLinear", value, step, zero)

    def _constant(self, value: Shaped[np.ndarray, "..."] | np.generic) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def _node(self, kind: str, *inputs: str, **attributes: Any) -> str:
        name = f"{kind}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, inputs, [name], name, **attributes))
        return name


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
