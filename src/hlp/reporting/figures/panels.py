"""What is drawn over a frame: region, local patches, votes, poses (paper, Fig. 7 and 8).

The panels of a target, and all poses of a frame at once.

The colours are told apart by people who see few (Okabe and Ito); the votes' grow in lightness too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from hlp.arrays import CameraMatrix, Mask, Pose, Positions, Rgb
from hlp.files import replaced
from hlp.geometry import project, transform
from hlp.records import (
    MILLIMETRES_PER_METRE,
    Frame,
    ObjectModel,
    PoseEstimate,
    Region,
    Target,
    TargetScore,
    Votes,
)
from hlp.rendering.rasterizer import render_depth, render_rgbd
from hlp.rendering.shading import FRONTAL_LIGHT
from hlp.reporting.figures import Color, titled, width_of, with_legend, write_words

VOTE_CELL = 8  # px, as in the paper
JPEG_QUALITY = 85
REGION_COLOR = (0, 200, 150)
PATCH_COLOR = (240, 228, 66)
ESTIMATE_COLOR = (86, 180, 233)
TRUTH_COLOR = (255, 165, 0)
BRIGHTEST_VOTES = (252, 255, 164)  # of OpenCV's map `inferno`
AXIS_COLORS = ((240, 60, 60), (70, 220, 70), (80, 130, 255))
_SUBPIXEL = 4  # bits of OpenCV's fixed-point coordinates
COARSE_COLOR = (255, 255, 255)
RIGHT_COLOR, WRONG_COLOR = ESTIMATE_COLOR, (230, 97, 0)
_MARGIN = 1.35  # of the poses' boxes around all of them
_NARROWEST = 32.0  # px of a frame that are enlarged


def write_picture(path: Path, image: Rgb, jpeg_quality: int = JPEG_QUALITY) -> None:
    """Write an RGB image, of the format of its name. Raises OSError naming an unwritable path."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    quality = [] if path.suffix.lower() == ".png" else [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
    _, encoded = cv2.imencode(path.suffix, bgr, quality)
    with replaced(path) as stream:
        stream.write(encoded.tobytes())


def draw_region(rgb: Rgb, mask: Mask) -> Rgb:
    """The picture with the region outlined and everything outside it darkened."""
    return outline(np.where(mask[..., None], rgb, rgb // 3).astype(np.uint8), mask, REGION_COLOR)


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


@dataclass(frozen=True)
class SeenTarget:
    """What the stages have found of an object in a frame.

    `coarse` is the coarse pose from which the estimate was refined.
    """

    frame: Frame
    model: ObjectModel
    region: Region
    votes: Votes
    coarse: Pose | None
    estimate: PoseEstimate | None
    truth: Target
    score: TargetScore

    @property
    def pose(self) -> Pose | None:
        """The estimated pose."""
        return None if self.estimate is None else self.estimate.pose_cam_obj

    @property
    def verdict(self) -> str:
        """The verdict on the pose in words, with the cause of a miss."""
        score = self.score
        words = "right" if score.add_correct else "wrong" if score.found else "not found"
        return f"{words}, {score.cause.replace('_', ' ')}" if score.cause else words


def draw_panels(seen: SeenTarget) -> Rgb:
    """One RGB picture of four panels below a line with the verdict, each with a legend.

    Accepted are the local patches that voted. Of the poses, the last panel shows the outlines,
    enlarged.
    """
    frame, region, votes = seen.frame, seen.region, seen.votes
    accepted = np.unique(votes.pixels, axis=0)
    true = seen.truth.pose_cam_obj
    size = (frame.depth.shape[0], frame.depth.shape[1])
    most = weight_by_cell(votes, frame.camera_matrix, size).max()
    bright = (f"{most:.2g}: weight of a cell's votes", BRIGHTEST_VOTES)
    poses = [
        ("coarse", COARSE_COLOR, seen.coarse),
        ("truth", TRUTH_COLOR, true),
        ("estimate", ESTIMATE_COLOR, seen.pose),
    ]
    near = enlarge(frame, seen.model, [true] if seen.pose is None else [true, seen.pose])
    outlines = near.rgb.copy()
    for _, color, pose in poses:
        if pose is not None:
            depth = render_depth(seen.model.proxy, pose[None], near.camera_matrix, size)
            outline(outlines, np.asarray(depth[0]) > 0, color)
    pictures = [
        (draw_region(frame.rgb, region.mask), [("region", REGION_COLOR)]),
        (draw_patches(frame.rgb, accepted), [("patch that voted", PATCH_COLOR)]),
        (draw_votes(frame, votes, seen.model, true), [bright, ("truth", TRUTH_COLOR)]),
        (outlines, [(name, color) for name, color, pose in poses if pose is not None]),
    ]
    titles = (
        f"1 candidate region, of {len(region.centers)} windows",
        f"2 local patches: {len(accepted)} accepted",
        f"3 {len(votes)} votes for the centroid, in {VOTE_CELL}x{VOTE_CELL} px cells",
        "4 pose, enlarged",
    )
    drawn = zip(pictures, titles, strict=True)
    panels = [titled(with_legend(*picture), title) for picture, title in drawn]
    picture = np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])])
    return titled(picture, describe_target(seen), 0.7)


def describe_target(seen: SeenTarget) -> str:
    """One line (ASCII): frame, object, verdict with its cause, errors and score."""
    words, score = f"{seen.frame.key}  {seen.model.name}: {seen.verdict}", seen.score
    if score.found:
        limit = MILLIMETRES_PER_METRE * 0.1 * seen.model.diameter
        words += (
            f"; ADD(-S) {MILLIMETRES_PER_METRE * score.add_error:.1f} mm (a tenth of the diameter: "
            f"{limit:.1f}), {math.degrees(score.rotation_error):.1f} deg, "
            f"{MILLIMETRES_PER_METRE * score.translation_error:.1f} mm; score {score.score:.2f}"
        )
    visible = score.visible_fraction
    return words if math.isnan(visible) else f"{words}; visible {visible:.2f}"


def enlarge(frame: Frame, model: ObjectModel, poses: Sequence[Pose]) -> Frame:
    """The part of a frame that shows an object in some poses, enlarged to the frame's own size.

    Its depth is the nearest pixel's. The whole frame where no pose can be seen.
    """
    height, width = frame.depth.shape
    points = [transform(pose, model.mesh.vertices) for pose in poses]
    seen = [project(cloud, frame.camera_matrix) for cloud in points if (cloud[:, 2] > 0).all()]
    if not seen:
        return frame
    pixels = np.clip(np.concatenate(seen), (0, 0), (width, height))
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    scale = 1.0 / max(*(_MARGIN * np.maximum(high - low, _NARROWEST) / (width, height)))
    if scale <= 1.0:
        return frame
    # A pixel's centre has integer coordinates.
    shift = (width / 2 - 0.5, height / 2 - 0.5) - scale * (low + high) / 2
    motion = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
    camera = np.vstack([motion, [0.0, 0.0, 1.0]]) @ frame.camera_matrix
    rgb = cv2.warpAffine(frame.rgb, motion, (width, height), flags=cv2.INTER_CUBIC)
    depth = cv2.warpAffine(frame.depth, motion, (width, height), flags=cv2.INTER_NEAREST)
    return replace(frame, rgb=rgb.astype(np.uint8), depth=depth, camera_matrix=camera)


def draw_overview(frame: Frame, targets: Sequence[SeenTarget]) -> Rgb:
    """The frame in colour with all poses: shaded models, outlines, axes, names with scores."""
    right = sum(seen.score.add_correct for seen in targets)
    missing = sum(seen.pose is None for seen in targets)
    title = f"{frame.key}: {right} of {len(targets)} targets right"
    title += f", {missing} without an answer" if missing else ""
    colors = {True: RIGHT_COLOR, False: WRONG_COLOR}
    posed = [(s.model, s.pose, colors[s.score.add_correct]) for s in targets if s.pose is not None]
    picture = draw_models(frame.rgb.copy(), posed, frame.camera_matrix)
    for seen in targets:
        if seen.pose is None or seen.estimate is None:
            continue
        center = transform(seen.pose, seen.model.centroid[None])
        inside = np.clip(project(center, frame.camera_matrix)[0], 0, picture.shape[1::-1])
        x, y = np.rint(inside).astype(int).tolist()
        words = f"{seen.model.name} {seen.estimate.score:.2f}"
        place = (x - width_of(words) // 2, y + 18)
        for color, thickness in (((20, 20, 20), 3), ((255, 255, 255), 1)):
            write_words(picture, words, place, color=color, thickness=thickness)
    legend = [("right by ADD(-S)", RIGHT_COLOR), ("wrong", WRONG_COLOR)]
    return titled(with_legend(picture, legend), title)
