"""Pictures of a frame: one target in six panels, and all poses of the frame at once."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from hlp.arrays import CameraMatrix, Image, Pose, Rgb
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
from hlp.rendering.rasterizer import render_depth
from hlp.reporting.figures import size_of, titled, with_legend, with_scale, write_words
from hlp.reporting.figures.panels import (
    ESTIMATE_COLOR,
    PATCH_COLOR,
    REGION_COLOR,
    TRUTH_COLOR,
    VOTE_CELL,
    VOTE_COLORS,
    draw_models,
    draw_patches,
    draw_poses,
    draw_region,
    draw_votes,
    outline,
    weight_by_cell,
)

COARSE_COLOR = (255, 255, 255)
RIGHT_COLOR, WRONG_COLOR = ESTIMATE_COLOR, (230, 97, 0)
LIMIT_MM = 20.0
"""Difference of depth at which its colour ends."""
# From "the model lies before what is seen" over white to "behind": told apart by all eyes.
_BEFORE, _SAME, _BEHIND = (33, 102, 172), (247, 247, 247), (178, 24, 43)
_NOTHING = 40  # grey level where there is no depth
_MARGIN = 1.35  # of the poses' boxes around all of them
_NARROWEST = 32.0  # px of a frame that are enlarged


@dataclass(frozen=True)
class SeenTarget:
    """What the stages have found of an object in a frame.

    `coarse` is the coarse pose from which the estimate was refined. `truth` and `score` are None
    where nothing is known of the truth.
    """

    frame: Frame
    model: ObjectModel
    region: Region
    votes: Votes
    coarse: Pose | None = None
    estimate: PoseEstimate | None = None
    truth: Target | None = None
    score: TargetScore | None = None

    @property
    def pose(self) -> Pose | None:
        """The estimated pose."""
        return None if self.estimate is None else self.estimate.pose_cam_obj

    @property
    def true_pose(self) -> Pose | None:
        """The true pose."""
        return None if self.truth is None else self.truth.pose_cam_obj


def draw_panels(seen: SeenTarget) -> Rgb:
    """One RGB picture of six panels below a line with the verdict, each with a legend.

    Accepted are the local patches that voted. The estimated pose is drawn shaded and with its axes,
    the true pose as an outline in another colour; either may be absent.
    """
    frame, region, votes = seen.frame, seen.region, seen.votes
    accepted = np.unique(votes.pixels, axis=0)
    pose, true = seen.pose, seen.true_pose
    size = (frame.depth.shape[0], frame.depth.shape[1])
    most = weight_by_cell(votes, frame.camera_matrix, size).max()
    region_picture = with_legend(draw_region(frame.rgb, region.mask), [("region", REGION_COLOR)])
    patches = with_legend(draw_patches(frame.rgb, accepted), [("patch that voted", PATCH_COLOR)])
    cells = draw_votes(frame, votes, seen.model, true)
    ring = "" if true is None else "; ring: truth"
    scale = f"{most:.2g}: weight of a cell's votes{ring}"
    poses = [("estimate", ESTIMATE_COLOR), ("truth", TRUTH_COLOR)]
    panels = [
        titled(region_picture, f"1 candidate region, of {len(region.centers)} windows"),
        titled(patches, f"2 local patches: {len(accepted)} accepted"),
        titled(
            with_scale(cells, VOTE_COLORS, scale),
            f"3 {len(votes)} votes for the centroid, in {VOTE_CELL}x{VOTE_CELL} px cells",
        ),
        titled(with_legend(draw_poses(frame, seen.model, pose, true), poses), "4 pose"),
        *_close_ups(seen),
    ]
    picture = np.vstack([np.hstack(panels[:3]), np.hstack(panels[3:])])
    return titled(picture, describe_target(seen), 0.7)


def describe_target(seen: SeenTarget) -> str:
    """One line (ASCII): frame, object, verdict with its cause, errors and score."""
    words = f"{seen.frame.key}  {seen.model.name}: "
    score, estimate = seen.score, seen.estimate
    if score is None:
        found = estimate is not None and estimate.pose_cam_obj is not None
        return words + (f"score {estimate.score:.2f}" if estimate and found else "no pose")
    cause = f", {score.cause.replace('_', ' ')}" if score.cause else ""
    words += "right" if score.add_correct else f"wrong{cause}" if score.found else f"missed{cause}"
    if score.found:
        limit = MILLIMETRES_PER_METRE * 0.1 * seen.model.diameter
        words += (
            f"; ADD(-S) {MILLIMETRES_PER_METRE * score.add_error:.1f} mm (a tenth of the diameter: "
            f"{limit:.1f}), {math.degrees(score.rotation_error):.1f} deg, "
            f"{MILLIMETRES_PER_METRE * score.translation_error:.1f} mm; score {score.score:.2f}"
        )
    visible = score.visible_fraction
    return words if math.isnan(visible) else f"{words}; visible {visible:.2f}"


def _close_ups(seen: SeenTarget) -> list[Rgb]:
    """The coarse against the fine pose, and rendered against observed depth."""
    frame, model, pose = seen.frame, seen.model, seen.pose
    named = [
        ("coarse", seen.coarse, COARSE_COLOR),
        ("truth", seen.true_pose, TRUTH_COLOR),
        ("fine", pose, ESTIMATE_COLOR),
    ]
    drawn = [(name, known, color) for name, known, color in named if known is not None]
    poses = {name: known for name, known, _ in drawn}
    exact = [poses[name] for name in ("truth", "fine") if name in poses]
    near = enlarge(frame, model, exact or list(poses.values()))
    outlines = draw_outlines(near, model, [(known, color) for _, known, color in drawn])
    zoom = with_legend(outlines, [(name, color) for name, _, color in drawn])
    if pose is None:
        depths, words = np.full_like(frame.rgb, _NOTHING), "6 depths: no pose"
    else:
        size = frame.rgb.shape[1::-1]
        depths = cv2.resize(draw_depths(near, model, pose, seen.coarse), size).astype(np.uint8)
        words = "6 depth: observed, rendered; difference: fine, coarse"
    legend = [(f"model {LIMIT_MM:.0f} mm in front", _BEFORE), ("behind", _BEHIND)]
    return [titled(zoom, "5 closer"), titled(with_legend(depths, legend), words)]


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


def draw_outlines(
    frame: Frame, model: ObjectModel, poses: Sequence[tuple[Pose, tuple[int, int, int]]]
) -> Rgb:
    """The frame in colour with the object's outline in each pose, in the colour given with it."""
    picture = frame.rgb.copy()
    for pose, color in poses:
        picture = outline(picture, _rendered(frame, model, pose) > 0, color)
    return picture


def draw_depths(frame: Frame, model: ObjectModel, pose: Pose, coarse: Pose | None) -> Rgb:
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
    small = [cv2.resize(tile, (width // 2, height // 2)).astype(np.uint8) for tile in tiles]
    return np.vstack([np.hstack(small[:2]), np.hstack(small[2:])])


def color_differences(rendered: Image, observed: Image) -> Rgb:
    """Rendered minus observed depth (m) as colours; dark grey where one of them is missing."""
    share = np.clip(MILLIMETRES_PER_METRE * (rendered - observed) / LIMIT_MM, -1.0, 1.0)[..., None]
    far = np.where(share < 0, np.array(_BEFORE), np.array(_BEHIND))
    colors = np.rint(np.array(_SAME) + np.abs(share) * (far - np.array(_SAME)))
    known = ((rendered > 0) & (observed > 0))[..., None]
    return np.where(known, colors, _NOTHING).astype(np.uint8)


def _rendered(frame: Frame, model: ObjectModel, pose: Pose) -> Image:
    height, width = frame.depth.shape
    depth = render_depth(model.proxy, pose[None], frame.camera_matrix, (height, width))
    return np.asarray(depth[0])


def _shades(depth: Image, near: float, far: float) -> Rgb:
    """Depth as colours from near (light) to far; dark grey where it is missing."""
    share = np.clip((far - depth) / max(far - near, 1e-9), 0.0, 1.0)
    scaled = np.rint(255 * share).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(scaled, cv2.COLORMAP_CIVIDIS), cv2.COLOR_BGR2RGB)
    return np.where(depth[..., None] > 0, colors, _NOTHING).astype(np.uint8)


@dataclass(frozen=True)
class ShownPose:
    """A pose of an object in a frame, what is written beside it, and whether it is right."""

    model: ObjectModel
    pose_cam_obj: Pose
    words: str
    right: bool


def draw_overview(frame: Frame, poses: Sequence[ShownPose], title: str) -> Rgb:
    """The frame in colour with all poses, far ones first: shaded models, outlines, axes, names."""
    colors = {True: RIGHT_COLOR, False: WRONG_COLOR}
    colored = [(shown.model, shown.pose_cam_obj, colors[shown.right]) for shown in poses]
    picture = draw_models(frame.rgb.copy(), colored, frame.camera_matrix)
    for shown in sorted(poses, key=lambda shown: -float(shown.pose_cam_obj[2, 3])):
        _write(picture, shown, frame.camera_matrix)
    legend = [("right by ADD(-S)", RIGHT_COLOR), ("wrong", WRONG_COLOR)]
    return titled(with_legend(picture, legend), title)


def _write(picture: Rgb, shown: ShownPose, camera: CameraMatrix) -> None:
    """The words below the object's centroid, light on dark, kept inside the picture."""
    center = transform(shown.pose_cam_obj, shown.model.centroid[None])
    if center[0, 2] <= 0:
        return
    x, y = np.clip(np.rint(project(center, camera)[0]), -1e4, 1e4).astype(int)
    long, high = size_of(shown.words)
    height, width = picture.shape[:2]
    place = (
        int(np.clip(x - long // 2, 2, max(width - long - 2, 2))),
        int(np.clip(y + 18, high + 2, height - 26)),
    )
    for color, thickness in (((20, 20, 20), 3), ((255, 255, 255), 1)):
        write_words(picture, shown.words, place, color=color, thickness=thickness)
