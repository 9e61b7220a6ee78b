"""Input of a local encoder: four channels of 32 × 32 pixels, chosen by name."""

from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Float32

from hlp.models.normals import normals_and_depth
from hlp.records import LocalPatches

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
