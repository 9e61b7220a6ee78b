"""Local encoders (paper, section 3.2): the interface of alternatives, and networks in detection."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, Protocol

import numpy as np
from jaxtyping import Float, Float32

from hlp.arrays import DepthPatches, Features, MaskPatches
from hlp.kernels import compiled, compiled_ahead
from hlp.models.network import Network
from hlp.records import LocalPatches
from hlp.settings import Named, Registry

if TYPE_CHECKING:
    from pytorch_lightning import LightningDataModule

    from hlp.models.network_training import OneCycleModule

RESOLUTION = 32  # px of a patch's side (paper, section 3.2)
STEM = "encoder"
"""Name, without its ending, of the ONNX files of a trained network."""
_CHUNK = 512
EncoderInput = Literal["rgbd", "normals_depth"]


class Encoder(Protocol):
    """Turns local patches into features; similar patches have a small Euclidean distance.

    `sees_color` says whether it needs patches with colour.
    """

    sees_color: bool

    def encode(self, patches: LocalPatches) -> Features:
        """Features (n, d) float32 of n patches."""


class EncoderTraining(Protocol):
    """Data and tools for training an encoder. Data are made only when requested."""

    def pair_batches(self, with_color: bool, batch_size: int) -> LightningDataModule:
        """Pairs of rendered patches of one surface point, in two views and conditions."""

    def pair_patches(self) -> tuple[DepthPatches, MaskPatches]:
        """Relative depth and validity of one patch of each pair, as rendered."""

    def frame_batches(
        self, per_frame: int, batch_size: int, rooms: bool, varied_light: bool
    ) -> LightningDataModule:
        """Patches of RGB-D frames without the objects, `per_frame` of each frame.

        With `rooms` also of the frames that are backgrounds. With `varied_light` a batch also holds
        the patches' colour under another light. Raises ValueError if there are no such frames.
        """

    def fit(self, module: OneCycleModule, data: LightningDataModule, epochs: int) -> None:
        """Train a module; its network is written into `folder` as weights and ONNX (`STEM`)."""

    @property
    def folder(self) -> Path:
        """The folder for everything that the encoder learns."""


class EncoderSettings(Named, Protocol):
    """Settings of an encoder of local patches."""

    needs_frames: ClassVar[bool]
    """Whether it trains on RGB-D frames without the objects instead of on rendered views."""

    @property
    def dimension(self) -> int:
        """Length of the feature."""

    def train(self, training: EncoderTraining) -> None:
        """Train into `training.folder`. The caller has set torch's seed."""

    def load(self, folder: Path, threads: int, device: str) -> Encoder:
        """The encoder that `train` wrote into a folder. A network runs on the device."""


ENCODERS: Registry[EncoderSettings] = Registry("encoder", "hlp.models")
"""Alternatives of config group `encoder`."""


class NetworkEncoder:
    """A network as encoder, with the same precision for views and scenes.

    `kind` names its input. With `unit_length`, features are divided by their norm, as contrastive
    training assumes.
    """

    def __init__(self, network: Network, kind: str, unit_length: bool) -> None:
        self.network = network
        self.kind = kind
        self.sees_color = kind == "rgbd"
        self.unit_length = unit_length

    def encode(self, patches: LocalPatches) -> Features:
        """Features (n, d) float32 of n patches."""
        starts = range(0, max(len(patches), 1), _CHUNK)
        chunks = (patches[i : i + _CHUNK] for i in starts)
        features = np.concatenate([self.network.run(patch_input(c, self.kind)) for c in chunks])
        if self.unit_length:
            norms = np.linalg.norm(features, axis=1, keepdims=True)
            features /= np.maximum(norms, np.float32(1e-12))
        return features


def patch_input(patches: LocalPatches, kind: str) -> Float32[np.ndarray, "n p p 4"]:
    """Channels in [-1, 1] of cut patches.

    `rgbd` is the paper's input (section 3.2). `normals_depth` needs no colour.
    """
    if kind != "rgbd":
        return normals_with_depth(patches.depth, patches.valid)
    out = np.empty((*patches.depth.shape, 4), dtype=np.float32)
    np.multiply(patches.color, np.float32(2.0 / 255.0), out=out[..., :3])
    out[..., :3] -= np.float32(1.0)
    out[..., 3] = patches.depth
    return out


def normals_with_depth(depth: DepthPatches, valid: MaskPatches) -> Float32[np.ndarray, "n p p 4"]:
    """Unit normals of the patches' depth, 0 where it is not valid, and the depth itself."""
    out = np.empty((*depth.shape, 4), dtype=np.float32)
    single = np.ascontiguousarray(depth, dtype=np.float32)
    _fill_normals(single, np.ascontiguousarray(valid), out)
    return out


@compiled_ahead()
def _fill_normals(
    depth: Float32[np.ndarray, "n p p"], valid: MaskPatches, out: Float32[np.ndarray, "n p p 4"]
) -> None:
    """Fill `out` with unit normals (0 where not valid) and the unchanged depth, all float32.

    For the normals, depth is smoothed twice over the valid pixels of 3 × 3. At a pixel pitch of
    1–3 mm, a Kinect's noise and quantisation are as large as the differences between pixels.
    """
    count, size = depth.shape[:2]
    surface = np.empty((size, size), dtype=np.float32)
    weight, rows = np.empty_like(surface), np.empty_like(surface)
    one, none = np.float32(1.0), np.float32(0.0)
    # In units of half the metric size, as depth is, the pitch is 2 / size. Differences span two.
    scale = np.float32(size / 4.0)
    for i in range(count):
        for y in range(size):
            for x in range(size):
                weight[y, x] = one if valid[i, y, x] else none
                surface[y, x] = depth[i, y, x] * weight[y, x]
        for _ in range(2):
            _average(surface, rows)
            _average(weight, rows)
        for y in range(size):
            for x in range(size):
                known = weight[y, x] > np.float32(0.05)
                surface[y, x] = surface[y, x] / weight[y, x] if known else depth[i, y, x]
        for y in range(size):
            above, below = max(y - 1, 0), min(y + 1, size - 1)
            for x in range(size):
                left, right = max(x - 1, 0), min(x + 1, size - 1)
                dx = (surface[y, right] - surface[y, left]) * scale
                dy = (surface[below, x] - surface[above, x]) * scale
                length = np.sqrt(dx * dx + dy * dy + one)
                share = one / length if valid[i, y, x] else none
                out[i, y, x, 0] = dx * share
                out[i, y, x, 1] = dy * share
                out[i, y, x, 2] = -share
                out[i, y, x, 3] = depth[i, y, x]


@compiled()
def _average(image: Float[np.ndarray, "p p"], rows: Float[np.ndarray, "p p"]) -> None:
    """Mean of 3 × 3 pixels in place, without pixels beyond the border; `rows` is a buffer."""
    size = image.shape[0]
    last, ninth = size - 1, np.float32(1.0 / 9.0)
    for y in range(size):
        rows[y, 0] = image[y, 0] + image[y, 1]
        for x in range(1, last):
            rows[y, x] = image[y, x - 1] + image[y, x] + image[y, x + 1]
        rows[y, last] = image[y, last - 1] + image[y, last]
    for x in range(size):
        image[0, x] = (rows[0, x] + rows[1, x]) * ninth
    for y in range(1, last):
        for x in range(size):
            image[y, x] = (rows[y - 1, x] + rows[y, x] + rows[y + 1, x]) * ninth
    for x in range(size):
        image[last, x] = (rows[last - 1, x] + rows[last, x]) * ninth
