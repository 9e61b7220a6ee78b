"""An object seen closer: outlines of its poses, and rendered against observed depth."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from hlp.geometry import project, transform
from hlp.records import MILLIMETRES_PER_METRE, Frame, ObjectModel
from hlp.rendering.rasterizer import render_depth
from hlp.reporting.figures.panels import outline

Image = UInt8[np.ndarray, "h w 3"]
Pose = Float[np.ndarray, "4 4"]

LIMIT_MM = 20.0
"""Difference of depth at which its colour ends."""
_MARGIN = 1.35  # of the poses' boxes around all of them
_FEW = 32.0  # px: the narrowest part of a frame that is enlarged
# From "the model lies before what is seen" over white to "behind": told apart by all eyes.
_BEFORE, _SAME, _BEHIND = (33, 102, 172), (247, 247, 247), (178, 24, 43)
_NOTHING = 40


def enlarge(frame: Frame, model: ObjectModel, poses: Sequence[Pose]) -> Frame:
    """The part of a frame that shows an object in some poses, enlarged to the frame's own size.

    Its depth is the nearest pixel's. The whole frame where no pose can be seen.
    """
    height, width = frame.depth.shape
    points = [transform(pose, model.mesh.vertices) for pose in poses]
    seen = [project(each, frame.camera_matrix) for each in points if (each[:, 2] > 0).all()]
    if not seen:
        return frame
    pixels = np.clip(np.concatenate(seen), (0, 0), (width, height))
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    scale = 1.0 / max(*(_MARGIN * np.maximum(high - low, _FEW) / (width, height)))
    if scale <= 1.0:
        return frame
    # A pixel's centre has integer coordinates.
    shift = (width / 2 - 0.5, height / 2 - 0.5) - scale * (low + high) / 2
    motion = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
    camera = np.vstack([motion, [0.0, 0.0, 1.0]]) @ frame.camera_matrix
    rgb = cv2.warpAffine(frame.rgb, motion, (width, height), flags=cv2.INTER_CUBIC)
    depth = cv2.warpAffine(frame.depth, motion, (width, height), flags=cv2.INTER_NEAREST)
    return replace(frame, rgb=rgb.astype(np.uint8), depth=depth, camera_matrix=camera)


def draw_outlines(
    frame: Frame, model: ObjectModel, poses: Sequence[tuple[Pose, tuple[int, int, int]]]
) -> Image:
    """The frame in colour with the object's outline in each pose, in the colour given with it."""
    picture = frame.rgb.copy()
    for pose, color in poses:
        picture = outline(picture, _rendered(frame, model, pose) > 0, color)
    return picture


def draw_depths(
    frame: Frame, model: ObjectModel, pose: Pose, coarse: Pose | None
) -> UInt8[np.ndarray, "h w 3"]:
    """Four tiles: observed and rendered depth; their difference, and that of the coarse pose.

    Where the model hides what is seen the difference is blue, where it lies behind it red, both
    fully from `LIMIT_MM` on. The coarse pose's tile is empty without one.
    """
    rendered = _rendered(frame, model, pose)
    shown = rendered[rendered > 0]
    middle = float(np.median(shown if len(shown) else frame.depth))
    ends = (middle - 0.75 * model.diameter, middle + 0.75 * model.diameter)
    before = np.zeros_like(rendered) if coarse is None else _rendered(frame, model, coarse)
    tiles = [
        _shades(frame.depth, *ends),
        _shades(rendered, *ends),
        color_differences(rendered, frame.depth),
        color_differences(before, frame.depth),
    ]
    height, width = frame.depth.shape
    small = [cv2.resize(each, (width // 2, height // 2)).astype(np.uint8) for each in tiles]
    return np.vstack([np.hstack(small[:2]), np.hstack(small[2:])])


def color_differences(
    rendered: Float[np.ndarray, "h w"], observed: Float[np.ndarray, "h w"]
) -> Image:
    """Rendered minus observed depth (m) as colours; dark grey where one of them is missing."""
    share = np.clip(MILLIMETRES_PER_METRE * (rendered - observed) / LIMIT_MM, -1.0, 1.0)[..., None]
    far = np.where(share < 0, np.array(_BEFORE), np.array(_BEHIND))
    colors = np.rint(np.array(_SAME) + np.abs(share) * (far - np.array(_SAME)))
    known = ((rendered > 0) & (observed > 0))[..., None]
    return np.where(known, colors, _NOTHING).astype(np.uint8)


def _rendered(frame: Frame, model: ObjectModel, pose: Pose) -> Float[np.ndarray, "h w"]:
    height, width = frame.depth.shape
    depth = render_depth(model.proxy, pose[None], frame.camera_matrix, (height, width))
    return np.asarray(depth[0])


def _shades(depth: Float[np.ndarray, "h w"], near: float, far: float) -> Image:
    """Depth as colours from near (light) to far; dark grey where it is missing."""
    share = np.clip((far - depth) / max(far - near, 1e-9), 0.0, 1.0)
    scaled = np.rint(255 * share).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(scaled, cv2.COLORMAP_CIVIDIS), cv2.COLOR_BGR2RGB)
    return np.where(depth[..., None] > 0, colors, _NOTHING).astype(np.uint8)
