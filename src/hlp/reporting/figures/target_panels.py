"""Pictures of a frame: one target in six panels, and all poses of the frame at once."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from hlp.arrays import Image, Pose, Rgb
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
from hlp.reporting.figures import size_of, titled, with_legend, write_words
from hlp.reporting.figures.panels import (
    BRIGHTEST_VOTES,
    ESTIMATE_COLOR,
    PATCH_COLOR,
    REGION_COLOR,
    TRUTH_COLOR,
    VOTE_CELL,
    draw_models,
    draw_patches,
    draw_poses,
    draw_region,
    draw_votes,
    outline,
    rendered_depth,
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
    """One RGB picture of six panels below a line with the verdict, each with a legend.

    Accepted are the local patches that voted. The estimated pose is drawn shaded and with its axes,
    the true pose as an outline in another colour.
    """
    frame, region, votes = seen.frame, seen.region, seen.votes
    accepted = np.unique(votes.pixels, axis=0)
    pose, true = seen.pose, seen.truth.pose_cam_obj
    size = (frame.depth.shape[0], frame.depth.shape[1])
    most = weight_by_cell(votes, frame.camera_matrix, size).max()
    region_picture = with_legend(draw_region(frame.rgb, region.mask), [("region", REGION_COLOR)])
    patches = with_legend(draw_patches(frame.rgb, accepted), [("patch that voted", PATCH_COLOR)])
    cells = draw_votes(frame, votes, seen.model, true)
    bright = [(f"{most:.2g}: weight of a cell's votes", BRIGHTEST_VOTES), ("truth", TRUTH_COLOR)]
    poses = [("estimate", ESTIMATE_COLOR), ("truth", TRUTH_COLOR)]
    panels = [
        titled(region_picture, f"1 candidate region, of {len(region.centers)} windows"),
        titled(patches, f"2 local patches: {len(accepted)} accepted"),
        titled(
            with_legend(cells, bright),
            f"3 {len(votes)} votes for the centroid, in {VOTE_CELL}x{VOTE_CELL} px cells",
        ),
        titled(with_legend(draw_poses(frame, seen.model, pose, true), poses), "4 pose"),
        *_close_ups(seen),
    ]
    picture = np.vstack([np.hstack(panels[:3]), np.hstack(panels[3:])])
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


def _close_ups(seen: SeenTarget) -> list[Rgb]:
    """The coarse against the fine pose, and rendered against observed depth."""
    frame, model, pose, true = seen.frame, seen.model, seen.pose, seen.truth.pose_cam_obj
    near = enlarge(frame, model, [true] if pose is None else [true, pose])
    outlines, legend = near.rgb.copy(), []
    for name, known, color in (
        ("coarse", seen.coarse, COARSE_COLOR),
        ("truth", true, TRUTH_COLOR),
        ("fine", pose, ESTIMATE_COLOR),
    ):
        if known is not None:
            outline(outlines, rendered_depth(near, model, known) > 0, color)
            legend.append((name, color))
    rendered = np.zeros_like(near.depth) if pose is None else rendered_depth(near, model, pose)
    signs = [(f"model {LIMIT_MM:.0f} mm in front", _BEFORE), ("behind", _BEHIND)]
    depths = with_legend(color_differences(rendered, near.depth), signs)
    return [
        titled(with_legend(outlines, legend), "5 closer"),
        titled(depths, "6 rendered minus observed depth"),
    ]


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


def color_differences(rendered: Image, observed: Image) -> Rgb:
    """Rendered minus observed depth (m) as colours; dark grey where one of them is missing."""
    share = np.clip(MILLIMETRES_PER_METRE * (rendered - observed) / LIMIT_MM, -1.0, 1.0)[..., None]
    far = np.where(share < 0, np.array(_BEFORE), np.array(_BEHIND))
    colors = np.rint(np.array(_SAME) + np.abs(share) * (far - np.array(_SAME)))
    known = ((rendered > 0) & (observed > 0))[..., None]
    return np.where(known, colors, _NOTHING).astype(np.uint8)


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
        place = (x - size_of(words)[0] // 2, y + 18)
        for color, thickness in (((20, 20, 20), 3), ((255, 255, 255), 1)):
            write_words(picture, words, place, color=color, thickness=thickness)
    legend = [("right by ADD(-S)", RIGHT_COLOR), ("wrong", WRONG_COLOR)]
    return titled(with_legend(picture, legend), title)
