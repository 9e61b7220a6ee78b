"""Sheets of small images: rows with a name, tiles beside each other, words below them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from hlp.geometry import project, transform
from hlp.records import MILLIMETRES_PER_METRE, Frame, LocalPatches, ObjectModel
from hlp.rendering.rasterizer import render_depth
from hlp.reporting.figures.panels import ESTIMATE_COLOR, axes, outline, posed
from hlp.reporting.figures.saving import titled, with_legend

Image = UInt8[np.ndarray, "h w 3"]

NOTHING = 128
"""Grey level where a tile shows nothing: that of patches beyond the range of depth."""
_DEPTHS = cv2.COLORMAP_VIRIDIS  # without any grey, which means that there is no depth
_GAP, _DARK, _WORDS = 4, 24, 16
_FONT, _SMALL, _LIGHT = cv2.FONT_HERSHEY_SIMPLEX, 0.38, (235, 235, 235)


def depth_tile(depth: Float[np.ndarray, "p p"], valid: Bool[np.ndarray, "p p"]) -> Image:
    """Relative depth from -1 (near, yellow) to 1 (far, violet); grey where it is not valid."""
    return np.where(valid[..., None], _colors(depth), NOTHING).astype(np.uint8)


def patch_tile(patches: LocalPatches, row: int, size: int) -> Image:
    """Colour and depth of a local patch beside each other, each with sides of `size` px."""
    depth = depth_tile(patches.depth[row], patches.valid[row])
    return beside([resized(patches.color[row], size), resized(depth, size)])


def with_depths(picture: Image, words: str = "", *, missing: bool = True) -> Image:
    """The picture above a legend of the colours of depth, and further words (ASCII).

    Without `missing`, the legend does not name the grey of missing depth.
    """
    near, middle, far = _colors(np.array([[-1.0, 0.0, 1.0]]))[0].tolist()
    entries = [
        ("depth: near", tuple(near)),
        ("as the middle", tuple(middle)),
        ("far", tuple(far)),
    ]
    if missing:
        entries.append(("none, or outside", (NOTHING,) * 3))
    shown = with_legend(picture, entries)
    return with_legend(shown, [(words, (_DARK,) * 3)]) if words else shown


def resized(tile: Image, size: int) -> Image:
    """A square tile with sides of `size` px; pixels stay square where it grows."""
    way = cv2.INTER_AREA if size < len(tile) else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(tile, (size, size), interpolation=way), dtype=np.uint8)


def beside(tiles: Sequence[Image]) -> Image:
    """Tiles of one height in a row, without gaps."""
    return np.hstack(list(tiles))


def below(tile: Image, words: str) -> Image:
    """The tile with words (ASCII) below it."""
    bar = np.full((_WORDS, tile.shape[1], 3), _DARK, dtype=np.uint8)
    cv2.putText(bar, words, (2, _WORDS - 5), _FONT, _SMALL, _LIGHT, 1, cv2.LINE_AA)
    return np.vstack([tile, bar])


def sheet(rows: Sequence[tuple[str, Sequence[Image]]]) -> UInt8[np.ndarray, "_ _ 3"]:
    """Rows of tiles of one size, each behind its name (ASCII). Shorter rows are filled up.

    Raises ValueError without any tile.
    """
    longest = max((len(tiles) for _, tiles in rows), default=0)
    if longest == 0:
        raise ValueError("a sheet needs at least one tile")
    shape = next(tiles[0].shape for _, tiles in rows if tiles)
    empty = np.full(shape, _DARK, dtype=np.uint8)
    lengths = [cv2.getTextSize(name, _FONT, _SMALL, 1)[0][0] for name, _ in rows]
    left = max(lengths) + 2 * _GAP
    lines = []
    for name, tiles in rows:
        label = np.full((shape[0], left, 3), _DARK, dtype=np.uint8)
        place = (_GAP, shape[0] // 2 + 4)
        cv2.putText(label, name, place, _FONT, _SMALL, _LIGHT, 1, cv2.LINE_AA)
        filled = [*tiles, *[empty] * (longest - len(tiles))]
        lines.append(_framed(np.hstack([label, *(_framed(tile, 1) for tile in filled)]), 0))
    return np.vstack(lines)


def _colors(depth: Float[np.ndarray, "h w"]) -> Image:
    levels = np.rint(127.5 * (1.0 - np.clip(depth, -1.0, 1.0))).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(levels, _DEPTHS), cv2.COLOR_BGR2RGB)
    return np.asarray(colors, dtype=np.uint8)


def _framed(tile: Image, axis: int) -> Image:
    """A gap behind (axis 1) or below (axis 0) a tile."""
    height, width = tile.shape[:2]
    shape = (height, _GAP, 3) if axis else (_GAP, width, 3)
    return np.concatenate([tile, np.full(shape, _DARK, dtype=np.uint8)], axis=axis)


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


RIGHT_COLOR, WRONG_COLOR = ESTIMATE_COLOR, (230, 97, 0)
_TITLE_FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True)
class ShownPose:
    """A pose of an object in a frame, what is written beside it, and whether it is right."""

    model: ObjectModel
    pose_cam_obj: Float[np.ndarray, "4 4"]
    words: str
    right: bool


def draw_overview(
    frame: Frame, poses: Sequence[ShownPose], title: str
) -> UInt8[np.ndarray, "_ _ 3"]:
    """The frame in colour with all poses, far ones first: shaded models, outlines, axes, names."""
    picture = frame.rgb.copy()
    far_first = sorted(poses, key=lambda each: -float(each.pose_cam_obj[2, 3]))
    for each in far_first:
        color = RIGHT_COLOR if each.right else WRONG_COLOR
        picture = posed(picture, each.model, each.pose_cam_obj, frame.camera_matrix, color)
        picture = axes(picture, each.model, each.pose_cam_obj, frame.camera_matrix)
    for each in far_first:
        _write(picture, each, frame.camera_matrix)
    legend = [("right by ADD(-S)", RIGHT_COLOR), ("wrong", WRONG_COLOR)]
    return titled(with_legend(picture, legend), title)


def _write(
    picture: UInt8[np.ndarray, "h w 3"], shown: ShownPose, camera: Float[np.ndarray, "3 3"]
) -> None:
    """The words below the object's centroid, light on dark, kept inside the picture."""
    center = transform(shown.pose_cam_obj, shown.model.centroid[None])
    if center[0, 2] <= 0:
        return
    x, y = np.clip(np.rint(project(center, camera)[0]), -1e4, 1e4).astype(int)
    (long, high), _ = cv2.getTextSize(shown.words, _TITLE_FONT, 0.42, 1)
    height, width = picture.shape[:2]
    x = int(np.clip(x - long // 2, 2, max(width - long - 2, 2)))
    y = int(np.clip(y + 18, high + 2, height - 26))
    cv2.putText(picture, shown.words, (x, y), _TITLE_FONT, 0.42, (20, 20, 20), 3, cv2.LINE_AA)
    cv2.putText(picture, shown.words, (x, y), _TITLE_FONT, 0.42, (255, 255, 255), 1, cv2.LINE_AA)
