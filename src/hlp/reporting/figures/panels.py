"""What is drawn over a frame: region, local patches, votes, poses (paper, Fig. 7 and 8).

The colours are told apart by people who see few (Okabe and Ito); the votes' grow in lightness too.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from hlp.arrays import CameraMatrix, Image, Mask, Pose, Positions, Rgb
from hlp.files import replaced
from hlp.geometry import project, transform
from hlp.records import Frame, ObjectModel, Votes
from hlp.rendering.rasterizer import FRONTAL_LIGHT, render_depth, render_rgbd
from hlp.reporting.figures import Color

VOTE_CELL = 8  # px, as in the paper
JPEG_QUALITY = 85
REGION_COLOR = (0, 200, 150)
PATCH_COLOR = (240, 228, 66)
ESTIMATE_COLOR = (86, 180, 233)
TRUTH_COLOR = (255, 165, 0)
BRIGHTEST_VOTES = (252, 255, 164)  # of OpenCV's map `inferno`
AXIS_COLORS = ((240, 60, 60), (70, 220, 70), (80, 130, 255))
_SUBPIXEL = 4  # bits of OpenCV's fixed-point coordinates


def write_picture(path: Path, image: Rgb, jpeg_quality: int = JPEG_QUALITY) -> None:
    """Write an RGB image, of the format of its name. Raises OSError naming an unwritable path."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    quality = [] if path.suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
    _, encoded = cv2.imencode(path.suffix, bgr, quality)
    with replaced(path) as stream:
        stream.write(encoded.tobytes())


def draw_region(rgb: Rgb, mask: Mask) -> Rgb:
    """The picture with the region outlined and everything outside it darkened."""
    picture = np.where(mask[..., None], rgb, rgb // 3).astype(np.uint8)
    return outline(picture, mask, REGION_COLOR)


def draw_patches(rgb: Rgb, pixels: Positions) -> Rgb:
    """A dot at the centre of every accepted local patch, on the darkened picture."""
    picture = _grey(rgb, 0.7)
    for center in _fixed_point(pixels):
        cv2.circle(picture, center, 2 << _SUBPIXEL, PATCH_COLOR, -1, cv2.LINE_AA, _SUBPIXEL)
    return picture


def weight_by_cell(
    votes: Votes, camera_matrix: CameraMatrix, shape: tuple[int, int]
) -> Float[np.ndarray, "rows columns"]:
    """Weight of the votes for the centroid in each cell of 8×8 px of the image.

    The last cells may reach beyond the image. Votes outside it or behind the camera do not count.
    """
    ahead = votes.centroids_cam[:, 2] > 0
    x, y = project(votes.centroids_cam[ahead], camera_matrix).T
    # A pixel's centre has integer coordinates, so pixel 0 begins at -0.5.
    edges = [np.arange(-(-size // VOTE_CELL) + 1) * VOTE_CELL - 0.5 for size in shape]
    sums, *_ = np.histogram2d(y, x, edges, weights=votes.weights[ahead])
    return np.asarray(sums)


def draw_votes(frame: Frame, votes: Votes, model: ObjectModel, true_pose: Pose) -> Rgb:
    """Cells coloured by the weight of their votes, dark for little; a ring marks the truth."""
    height, width = frame.depth.shape

    def enlarged(cells: np.ndarray) -> np.ndarray:
        return cells.repeat(VOTE_CELL, axis=0).repeat(VOTE_CELL, axis=1)[:height, :width]

    sums = weight_by_cell(votes, frame.camera_matrix, (height, width))
    scaled = np.rint(sums * (255.0 / max(sums.max(), 1e-9))).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(scaled, cv2.COLORMAP_INFERNO), cv2.COLOR_BGR2RGB)
    grey = _grey(frame.rgb, 0.5)
    mixed = (3 * enlarged(colors).astype(np.uint16) + grey) // 4
    picture = np.where(enlarged(sums > 0)[..., None], mixed, grey).astype(np.uint8)
    center = project(transform(true_pose, model.centroid[None]), frame.camera_matrix)
    (x, y), *_ = np.rint(center).astype(int).tolist()
    cv2.circle(picture, (x, y), 12, TRUTH_COLOR, 1, cv2.LINE_AA)
    return picture


def draw_poses(frame: Frame, model: ObjectModel, pose: Pose | None, true_pose: Pose) -> Rgb:
    """Shaded model, outline and axes over the grey picture; the true pose as an outline only."""
    picture = draw_detections(frame, [] if pose is None else [(model, pose)])
    return outline(picture, rendered_depth(frame, model, true_pose) > 0, TRUTH_COLOR)


def rendered_depth(frame: Frame, model: ObjectModel, pose: Pose) -> Image:
    """Depth of an object alone, as the frame's camera sees it (m, 0 where it is not)."""
    height, width = frame.depth.shape
    depth = render_depth(model.proxy, pose[None], frame.camera_matrix, (height, width))
    return np.asarray(depth[0])


def draw_detections(frame: Frame, poses: Sequence[tuple[ObjectModel, Pose]]) -> Rgb:
    """Shaded models, outlines and axes of several objects over the grey picture, far ones first."""
    colored = [(model, pose, ESTIMATE_COLOR) for model, pose in poses]
    return draw_models(_grey(frame.rgb, 0.8), colored, frame.camera_matrix)


def draw_models(
    picture: Rgb, poses: Sequence[tuple[ObjectModel, Pose, Color]], camera_matrix: CameraMatrix
) -> Rgb:
    """Shaded models over a picture, far ones first, with their axes and outlines in colours."""
    size = (picture.shape[0], picture.shape[1])
    for model, pose, color in sorted(poses, key=lambda posed: -float(posed[1][2, 3])):
        shaded, depth = render_rgbd(model.mesh, pose, camera_matrix, size, FRONTAL_LIGHT)
        mixed = (3 * shaded.astype(np.uint16) + picture) // 4
        picture = np.where(depth[..., None] > 0, mixed, picture).astype(np.uint8)
        picture = _draw_axes(outline(picture, depth > 0, color), model, pose, camera_matrix)
    return picture


def _draw_axes(picture: Rgb, model: ObjectModel, pose: Pose, camera_matrix: CameraMatrix) -> Rgb:
    """The object's x (red), y (green) and z (blue) from its centroid, 0.6 diameters long."""
    ends = model.centroid + np.vstack([np.zeros(3), 0.6 * model.diameter * np.eye(3)])
    points = transform(pose, ends)
    if (points[:, 2] <= 0).any():
        return picture
    origin, *tips = _fixed_point(project(points, camera_matrix))
    for tip, color in zip(tips, AXIS_COLORS, strict=True):
        cv2.line(picture, origin, tip, color, 2, cv2.LINE_AA, _SUBPIXEL)
    return picture


def outline(picture: Rgb, mask: Mask, color: Color) -> Rgb:
    """The picture itself, with the border of a mask drawn into it."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, contours, -1, color, 1)
    return picture


def _grey(rgb: Rgb, brightness: float) -> Rgb:
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY) * brightness
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


def _fixed_point(pixels: Positions) -> list[tuple[int, int]]:
    """Pixels in the fixed-point form that OpenCV draws with `shift`, clipped to its range."""
    scaled = np.rint(np.clip(pixels, -1e5, 1e5) * (1 << _SUBPIXEL)).astype(int)
    return [(int(x), int(y)) for x, y in scaled]
