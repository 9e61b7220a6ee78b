"""The paper's four pictures of one object in one frame (Fig. 7 and 8)."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from hlp.files import replaced
from hlp.geometry import project, transform
from hlp.records import Frame, ObjectModel, PoseEstimate, Region, Target, Votes
from hlp.rendering.light import FRONTAL_LIGHT
from hlp.rendering.rasterizer import render_depth, render_rgbd

Image = UInt8[np.ndarray, "h w 3"]

VOTE_CELL = 8  # px, as in the paper
REGION_COLOR = (80, 220, 120)
PATCH_COLOR = (255, 200, 40)
ESTIMATE_COLOR = (60, 230, 90)
TRUTH_COLOR = (255, 90, 200)
AXIS_COLORS = ((240, 60, 60), (70, 220, 70), (80, 130, 255))
TITLE_HEIGHT = 26
_SUBPIXEL = 4  # bits of OpenCV's fixed-point coordinates


def draw_panels(
    frame: Frame,
    model: ObjectModel,
    region: Region,
    votes: Votes,
    estimate: PoseEstimate | None,
    truth: Target | None,
) -> UInt8[np.ndarray, "_ _ 3"]:
    """One RGB picture of four panels: region, accepted local patches, votes, and the pose.

    Accepted are the local patches that voted. The estimated pose is drawn shaded and with its axes,
    the true pose as an outline in another colour; either may be None.
    """
    accepted = np.unique(votes.pixels, axis=0)
    pose = estimate.pose_cam_obj if estimate is not None else None
    true_pose = truth.pose_cam_obj if truth is not None else None
    verdict = f"score {estimate.score:.2f} (green)" if estimate and pose is not None else "no pose"
    verdict += ", truth (pink)" if truth is not None else ""
    region_title = f"1 candidate region, of {len(region.centers)} windows"
    patches_title = f"2 local patches: {len(accepted)} accepted"
    votes_title = f"3 votes: {len(votes)}, in {VOTE_CELL}x{VOTE_CELL} px cells"
    panels = [
        _titled(draw_region(frame.rgb, region.mask), region_title),
        _titled(draw_patches(frame.rgb, accepted), patches_title),
        _titled(draw_votes(frame, votes, model, true_pose), votes_title),
        _titled(draw_poses(frame, model, pose, true_pose), f"4 {model.name}: {verdict}"),
    ]
    return np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])])


def write_png(path: Path, image: Image) -> None:
    """Write an RGB image. Raises OSError naming a path that cannot be written."""
    _, encoded = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    with replaced(path) as stream:
        stream.write(encoded.tobytes())


def draw_region(rgb: Image, mask: Bool[np.ndarray, "h w"]) -> Image:
    """The picture with the region outlined and everything outside it darkened."""
    picture = np.where(mask[..., None], rgb, rgb // 3).astype(np.uint8)
    return _outline(picture, mask, REGION_COLOR)


def draw_patches(rgb: Image, pixels: Float[np.ndarray, "n 2"]) -> Image:
    """A dot at the centre of every accepted local patch, on the darkened picture."""
    picture = _grey(rgb, 0.7)
    for center in _fixed_point(pixels):
        cv2.circle(picture, center, 2 << _SUBPIXEL, PATCH_COLOR, -1, cv2.LINE_AA, _SUBPIXEL)
    return picture


def votes_by_cell(
    votes: Votes, camera_matrix: Float[np.ndarray, "3 3"], shape: tuple[int, int]
) -> Int[np.ndarray, "rows columns"]:
    """Number of votes for the centroid in each cell of 8×8 px of the image.

    The last cells may reach beyond the image. Votes outside it or behind the camera do not count.
    """
    rows, columns = (-(-size // VOTE_CELL) for size in shape)
    points = votes.centroids_cam[votes.centroids_cam[:, 2] > 0]
    # A pixel's centre has integer coordinates, so pixel 0 begins at -0.5.
    cells = np.floor((project(points, camera_matrix) + 0.5) / VOTE_CELL)
    inside = ((cells >= 0) & (cells < (columns, rows))).all(axis=1)
    x, y = cells[inside].astype(int).T
    return np.bincount(y * columns + x, minlength=rows * columns).reshape(rows, columns)


def draw_votes(
    frame: Frame, votes: Votes, model: ObjectModel, true_pose: Float[np.ndarray, "4 4"] | None
) -> Image:
    """Cells coloured by their number of votes, few (blue) to many (red); a ring marks the truth."""
    height, width = frame.depth.shape
    counts = votes_by_cell(votes, frame.camera_matrix, (height, width))
    scaled = np.rint(counts * (255.0 / max(counts.max(), 1))).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(scaled, cv2.COLORMAP_TURBO), cv2.COLOR_BGR2RGB)
    cells = np.repeat(np.repeat(colors, VOTE_CELL, axis=0), VOTE_CELL, axis=1)[:height, :width]
    voted = np.repeat(np.repeat(counts > 0, VOTE_CELL, axis=0), VOTE_CELL, axis=1)[:height, :width]
    grey = _grey(frame.rgb, 0.5)
    picture = np.where(voted[..., None], (3 * cells.astype(np.uint16) + grey) // 4, grey)
    picture = picture.astype(np.uint8)
    if true_pose is not None:
        center = project(transform(true_pose, model.centroid[None]), frame.camera_matrix)
        (x, y), *_ = np.rint(center).astype(int).tolist()
        cv2.circle(picture, (x, y), 12, TRUTH_COLOR, 1, cv2.LINE_AA)
    return picture


def draw_poses(
    frame: Frame,
    model: ObjectModel,
    pose: Float[np.ndarray, "4 4"] | None,
    true_pose: Float[np.ndarray, "4 4"] | None,
) -> Image:
    """Shaded model, outline and axes over the grey picture; the true pose as an outline only."""
    picture = _grey(frame.rgb, 0.8)
    camera, shape = frame.camera_matrix, frame.depth.shape
    size = (shape[0], shape[1])
    if pose is not None:
        picture = _posed(picture, model, pose, camera)
    if true_pose is not None:
        true_depth = render_depth(model.proxy, true_pose[None], camera, size)[0]
        picture = _outline(picture, true_depth > 0, TRUTH_COLOR)
    return picture if pose is None else _axes(picture, model, pose, camera)


def draw_detections(
    frame: Frame, poses: Sequence[tuple[ObjectModel, Float[np.ndarray, "4 4"]]]
) -> Image:
    """Shaded models, outlines and axes of several objects over the grey picture, far ones first."""
    picture = _grey(frame.rgb, 0.8)
    for model, pose in sorted(poses, key=lambda each: -float(each[1][2, 3])):
        picture = _posed(picture, model, pose, frame.camera_matrix)
        picture = _axes(picture, model, pose, frame.camera_matrix)
    return picture


def _posed(
    picture: Image,
    model: ObjectModel,
    pose: Float[np.ndarray, "4 4"],
    camera_matrix: Float[np.ndarray, "3 3"],
) -> Image:
    """The shaded model over a picture, with its outline."""
    size = (picture.shape[0], picture.shape[1])
    shaded, depth = render_rgbd(model.mesh, pose, camera_matrix, size, FRONTAL_LIGHT)
    mixed = (3 * shaded.astype(np.uint16) + picture) // 4
    picture = np.where(depth[..., None] > 0, mixed, picture).astype(np.uint8)
    return _outline(picture, depth > 0, ESTIMATE_COLOR)


def _axes(
    picture: Image,
    model: ObjectModel,
    pose: Float[np.ndarray, "4 4"],
    camera_matrix: Float[np.ndarray, "3 3"],
) -> Image:
    """The object's x (red), y (green) and z (blue) from its centroid, 0.6 diameters long."""
    ends = model.centroid + np.vstack([np.zeros(3), 0.6 * model.diameter * np.eye(3)])
    points = transform(pose, ends)
    if (points[:, 2] <= 0).any():
        return picture
    origin, *tips = _fixed_point(project(points, camera_matrix))
    for tip, color in zip(tips, AXIS_COLORS, strict=True):
        cv2.line(picture, origin, tip, color, 2, cv2.LINE_AA, _SUBPIXEL)
    return picture


def _outline(picture: Image, mask: Bool[np.ndarray, "h w"], color: tuple[int, int, int]) -> Image:
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, contours, -1, color, 1)
    return picture


def _grey(rgb: Image, brightness: float) -> Image:
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY) * brightness
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


def _titled(picture: Image, title: str) -> Image:
    bar = np.full((TITLE_HEIGHT, picture.shape[1], 3), 24, dtype=np.uint8)
    cv2.putText(bar, title, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (235, 235, 235), 1, cv2.LINE_AA)
    return np.vstack([bar, picture])


def _fixed_point(pixels: Float[np.ndarray, "n 2"]) -> list[tuple[int, int]]:
    """Pixels in the fixed-point form that OpenCV draws with `shift`, clipped to its range."""
    scaled = np.rint(np.clip(pixels, -1e5, 1e5) * (1 << _SUBPIXEL)).astype(int)
    return [(int(x), int(y)) for x, y in scaled]
