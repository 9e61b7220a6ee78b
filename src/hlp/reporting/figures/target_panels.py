"""One target in six pictures: region, patches, votes, pose, a close-up, and depths."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

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
from hlp.reporting.figures.panels import (
    ESTIMATE_COLOR,
    PATCH_COLOR,
    REGION_COLOR,
    TRUTH_COLOR,
    VOTE_CELL,
    VOTE_COLORS,
    draw_patches,
    draw_poses,
    draw_region,
    draw_votes,
    weight_by_cell,
)
from hlp.reporting.figures.saving import titled, with_legend, with_scale
from hlp.reporting.figures.tiles import LIMIT_MM, draw_depths, draw_outlines, enlarge

COARSE_COLOR = (255, 255, 255)
_RED, _BLUE = (178, 24, 43), (33, 102, 172)


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
    coarse: Float[np.ndarray, "4 4"] | None = None
    estimate: PoseEstimate | None = None
    truth: Target | None = None
    score: TargetScore | None = None


def draw_panels(seen: SeenTarget) -> UInt8[np.ndarray, "_ _ 3"]:
    """One RGB picture of six panels below a line with the verdict, each with a legend.

    Accepted are the local patches that voted. The estimated pose is drawn shaded and with its axes,
    the true pose as an outline in another colour; either may be absent.
    """
    frame, region, votes = seen.frame, seen.region, seen.votes
    accepted = np.unique(votes.pixels, axis=0)
    pose, true = _pose(seen), _true(seen)
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
    score = seen.score
    if score is None:
        return words + ("no pose" if _pose(seen) is None else f"score {_score(seen):.2f}")
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


def _close_ups(seen: SeenTarget) -> list[UInt8[np.ndarray, "_ _ 3"]]:
    """The coarse against the fine pose, and rendered against observed depth."""
    model, pose, true = seen.model, _pose(seen), _true(seen)
    known = [each for each in (true, pose) if each is not None]
    near = enlarge(seen.frame, model, known or ([] if seen.coarse is None else [seen.coarse]))
    named = [
        ("coarse", seen.coarse, COARSE_COLOR),
        ("truth", true, TRUTH_COLOR),
        ("fine", pose, ESTIMATE_COLOR),
    ]
    drawn = [(name, each, color) for name, each, color in named if each is not None]
    outlines = draw_outlines(near, model, [(each, color) for _, each, color in drawn])
    zoom = with_legend(outlines, [(name, color) for name, _, color in drawn])
    if pose is None:
        depths, words = np.full_like(seen.frame.rgb, 40), "6 depths: no pose"
    else:
        drawn_depths = draw_depths(near, model, pose, seen.coarse)
        full = np.empty_like(seen.frame.rgb)
        depths = cv2.resize(drawn_depths, full.shape[1::-1]).astype(np.uint8)
        words = "6 depth: observed, rendered; difference: fine, coarse"
    legend = [(f"model {LIMIT_MM:.0f} mm in front", _BLUE), ("behind", _RED)]
    return [titled(zoom, "5 closer"), titled(with_legend(depths, legend), words)]


def _pose(seen: SeenTarget) -> Float[np.ndarray, "4 4"] | None:
    return None if seen.estimate is None else seen.estimate.pose_cam_obj


def _true(seen: SeenTarget) -> Float[np.ndarray, "4 4"] | None:
    return None if seen.truth is None else seen.truth.pose_cam_obj


def _score(seen: SeenTarget) -> float:
    return float("nan") if seen.estimate is None else seen.estimate.score
