"""Local encoders during detection (paper, section 3.2)."""

from typing import Literal, Protocol, get_args

import numpy as np
from jaxtyping import Bool, Float, Float32

from hlp.compiled import compiled
from hlp.models.network import Network
from hlp.records import LocalPatches

RESOLUTION = 32  # px of a patch's side (paper, section 3.2)
_CHUNK = 512


class Encoder(Protocol):
    """Turns local patches into features; similar patches have a small Euclidean distance.

    `sees_color` says whether it needs patches with colour.
    """

    sees_color: bool

    def encode(self, patches: LocalPatches) -> Float[np.ndarray, "n d"]:
        """Features (n, d) float32 of n patches."""


class NetworkEncoder:
    """A network as encoder, with the same precision for views and scenes.

    `kind` names its input. With `unit_length`, features are divided by their norm, as contrastive
    training assumes.
    """

    def __init__(self, network: Network, kind: str, unit_length: bool) -> None:
        self.network = network
        self.kind = kind
        self.sees_color = sees_color(kind)
        self.unit_length = unit_length

    def encode(self, patches: LocalPatches) -> Float[np.ndarray, "n d"]:
        """Features (n, d) float32 of n patches."""
        features = empty_features(self.network.outputs)
        if len(patches) == 0:
            return features
        images = patch_input(patches, self.kind)
        starts = range(0, len(images), _CHUNK)
        features = np.concatenate([self.network.run(images[i : i + _CHUNK]) for i in starts])
        if self.unit_length:
            norms = np.linalg.norm(features, axis=1, keepdims=True)
            features /= np.maximum(norms, np.float32(1e-12))
        return features


EncoderInput = Literal["rgbd", "normals_depth"]


def patch_input(patches: LocalPatches, kind: str) -> Float32[np.ndarray, "n p p 4"]:
    """Channels in [-1, 1] of cut patches.

    `rgbd` is the paper's input (section 3.2). `normals_depth` contains only shape and needs no
    colour. Raises ValueError for another kind, and for `rgbd` without colour.
    """
    if not sees_color(kind):
        return normals_with_depth(patches.depth, patches.valid)
    if patches.color.shape[-1] == 0:
        raise ValueError("the encoder's input 'rgbd' needs patches with colour")
    out = np.empty((*patches.depth.shape, 4), dtype=np.float32)
    np.multiply(patches.color, np.float32(2.0 / 255.0), out=out[..., :3])
    out[..., :3] -= np.float32(1.0)
    out[..., 3] = patches.depth
    return out


def sees_color(kind: str) -> bool:
    """Whether this kind of input needs colour. Raises ValueError for an unknown kind."""
    if kind not in get_args(EncoderInput):
        known = ", ".join(get_args(EncoderInput))
        raise ValueError(f"unknown encoder input '{kind}': choose one of {known}")
    return kind == "rgbd"


def normals_with_depth(
    depth: Float[np.ndarray, "n p p"], valid: Bool[np.ndarray, "n p p"]
) -> Float32[np.ndarray, "n p p 4"]:
    """Unit normals of the patches' depth, 0 where it is not valid, and the depth itself."""
    out = np.empty((*depth.shape, 4), dtype=np.float32)
    normals_and_depth(np.asarray(depth, dtype=np.float32), valid, out)
    return out


def surface_normals(
    depth: Float[np.ndarray, "n p p"], valid: Bool[np.ndarray, "n p p"]
) -> Float32[np.ndarray, "n p p 3"]:
    """Unit normals of the patches' depth, 0 where it is not valid."""
    return normals_with_depth(depth, valid)[..., :3]


def empty_features(dimension: int) -> Float32[np.ndarray, "0 d"]:
    """Features of zero patches."""
    return np.zeros((0, dimension), dtype=np.float32)


@compiled()
def normals_and_depth(
    depth: Float[np.ndarray, "n p p"],
    valid: Bool[np.ndarray, "n p p"],
    out: Float[np.ndarray, "n p p 4"],
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
