"""Evidence from what stages leave on disk, written by hand for a frame rendered of true poses."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from hlp.evaluation import EvaluationSettings
from hlp.evaluation.waterfall import VoteCounts
from hlp.geometry import project, rigid, transform
from hlp.method.find.trace import STAGES, ObjectTrace
from hlp.records import Frame, Hypotheses, Region, Target, TargetScore, Votes
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.refiner import Refinement
from hlp.rendering.rasterizer import render_depth
from hlp.runs.diagnosis import explain_misses, note_frame, visible_pixels
from hlp.stages.trace_files import read_trace, write_trace
from refinement_scene import model_of

K = np.array([[570.0, 0.0, 80.0], [0.0, 570.0, 60.0], [0.0, 0.0, 1.0]])
SHAPE = (120, 160)
SETTINGS = EvaluationSettings("test", [], 0.1, 5.0, 5.0, 0.5, 100)
NEAR = rigid(Rotation.from_rotvec([0.4, 0.2, 0.1]).as_matrix(), np.array([-0.05, 0.0, 0.8]))
FAR = rigid(Rotation.from_rotvec([-0.4, 0.3, 0.0]).as_matrix(), np.array([0.06, 0.0, 0.9]))
MODEL = model_of(trimesh.creation.box((0.06, 0.08, 0.10)).subdivide())
OWN = render_depth(MODEL.mesh, NEAR[None], K, SHAPE)[0] > 0
"""What nothing hides of the first target."""


def _frame():
    """Two boxes before a wall at 1.5 m."""
    rendered = render_depth(MODEL.mesh, np.stack([NEAR, FAR]), K, SHAPE)
    depth = np.where(rendered > 0, rendered, 1.5).min(axis=0)
    targets = (Target(1, NEAR, 1.0), Target(1, FAR, 1.0))
    return Frame(6, 3, np.zeros((*SHAPE, 3), np.uint8), depth, K, targets)


FRAME = _frame()
TARGET = FRAME.targets[0]
SOURCE = SimpleNamespace()
CENTERS = np.rint(project(np.stack([NEAR[:3, 3], FAR[:3, 3]]), K)).astype(np.int16)
CORNER = np.zeros((2, 2), np.int16)
PIXELS = np.concatenate([CENTERS, CENTERS, CORNER, CENTERS, CORNER])
"""Centres (x, y) of the patches that vote: on the boxes, and in the corner of the picture."""
MISSED = TargetScore(6, 3, 1, True, 1.0, 0.1, 1.0, 0.1, 0.5, False, False, False)


def _moved(pose, degrees, metres):
    turn = Rotation.from_rotvec(np.deg2rad([0.0, degrees, 0.0])).as_matrix()
    moved = pose.copy()
    moved[:3, :3] = pose[:3, :3] @ turn
    moved[:3, 3] += [metres, 0.0, 0.0]
    return moved


def _votes(pose, count):
    return np.stack([_moved(pose, 4.0, 0.002 * i) for i in range(count)])


WRONG, CLOSE = _moved(NEAR, 90.0, 0.2), _moved(NEAR, 20.0, 0.01)
EVERYWHERE = np.ones(SHAPE, dtype=bool)
LEFT = {
    "mask": EVERYWHERE,
    "coarse": [CLOSE, WRONG],
    "refined": [WRONG, NEAR],
    "sources": [1, 0],
    "votes": _votes(NEAR, 6),
}
"""What the stages have left: the first of the `refined` poses is the answer."""
NO_POSE = {"coarse": [], "refined": [], "sources": []}


def _trace(frame, mask, coarse, refined, sources, votes):
    grid = np.stack(np.meshgrid(np.arange(0, 160, 8), np.arange(0, 120, 8)), -1).reshape(-1, 2)
    kept = frame.depth[grid[:, 1], grid[:, 0]] > 0
    poses, count = np.reshape(coarse, (-1, 4, 4)), len(refined)
    fine = RefinedHypotheses(
        [Refinement(pose, 0) for pose in refined],
        np.zeros(count),
        np.array(sources),
        np.zeros((count, 4, 4)),
        (0,),
    )
    return ObjectTrace(
        Region(1, grid[kept].astype(float), np.ones(kept.sum(), np.float32), mask),
        votes=Votes(
            transform(votes, MODEL.centroid[None])[:, 0],
            votes[:, :3, :3],
            np.linspace(1.0, 2.0, len(votes)),
            np.arange(len(votes)),
            PIXELS[: len(votes)].astype(float),
        ),
        hypotheses=Hypotheses(poses, np.ones(len(poses))),
        refined=fine if refined else None,
        fits=(PoseFit(0.1, 0.9, 0.9, 3.0, 1.0),),
    )


def _noted(folder, frame=FRAME, **left):
    """A detection whose stages have left these on disk, and what is counted in the frame."""
    found = _trace(frame, **{**LEFT, **left})
    for stage in STAGES:
        (folder / stage).mkdir()
        write_trace(folder / stage, frame.key, stage, {1: found})
    dataset = SimpleNamespace(models={1: MODEL}, frames=SOURCE)
    trace = read_trace({stage: folder / stage for stage in STAGES}, frame.key)
    detection = SimpleNamespace(
        dataset=dataset, make=lambda stage: SimpleNamespace(folder=folder / stage)
    )
    return detection, note_frame(dataset, frame, trace, SETTINGS)


def _causes(folder, frame=FRAME, **left):
    detection, notes = _noted(folder, frame, **left)
    return [s.cause for s in explain_misses(detection, [notes], [MISSED, MISSED], SETTINGS)]


@pytest.mark.parametrize(
    ("cause", "changed"),
    [
        ("ranking", {}),
        ("refiner_diverged", {"refined": [WRONG, WRONG]}),
        ("screening", {"refined": [WRONG], "sources": [1]}),
        ("outside_basin", {"coarse": [WRONG, WRONG], "refined": [WRONG, WRONG]}),
        ("few_votes", {**NO_POSE, "votes": _votes(NEAR, 4)}),
        ("wrong_region", {**NO_POSE, "mask": ~EVERYWHERE}),
        # An answer on the surface, the wrong way round.
        ("symmetric_flip", {"refined": [_moved(NEAR, 180.0, 0.0), NEAR], "sources": [0, 0]}),
    ],
)
def test_what_the_stages_left_tells_the_cause(tmp_path, cause, changed):
    detection, notes = _noted(tmp_path, **changed)
    right = dataclasses.replace(MISSED, add_correct=True)
    explained = explain_misses(detection, [notes], [MISSED, right], SETTINGS)
    assert explained == [dataclasses.replace(MISSED, cause=cause), right]


def test_each_target_of_an_object_has_its_own_cause(tmp_path):
    left = {"coarse": [CLOSE], "refined": [WRONG], "sources": [0], "votes": _votes(FAR, 6)}
    assert _causes(tmp_path, **left) == ["refiner_diverged", "outside_basin"]


@pytest.mark.parametrize(
    ("cause", "depth"),
    [
        ("depth_missing", np.where(OWN, 0.0, FRAME.depth)),
        ("no_window", np.full_like(FRAME.depth, 0.3)),  # hidden
    ],
)
def test_missing_depth_and_missing_windows(tmp_path, cause, depth):
    frame = dataclasses.replace(FRAME, depth=depth)
    assert _causes(tmp_path, frame, **NO_POSE)[0] == cause


def test_visible_is_what_nothing_else_hides():
    assert (visible_pixels(SOURCE, FRAME, TARGET, MODEL) == OWN).all()
    depth = FRAME.depth.copy()
    depth[:, :60] = 0.5  # something stands before the left part
    depth[:, 60:64] = 0.0  # unknown
    shown = visible_pixels(SOURCE, dataclasses.replace(FRAME, depth=depth), TARGET, MODEL)
    assert 0 < shown.sum() < OWN.sum()
    assert (shown[:, 60:] == OWN[:, 60:]).all() and not shown[:, :60].any()


def test_the_data_sets_own_mask_is_taken_where_it_has_one():
    given = FRAME.depth < 1.0
    source = SimpleNamespace(visible_mask=lambda frame, target: given)
    assert visible_pixels(source, FRAME, TARGET, MODEL) is given
    source.visible_mask = lambda frame, target: None
    assert (visible_pixels(source, FRAME, TARGET, MODEL) == OWN).all()


def test_votes_near_either_target_are_good_and_those_on_either_are_the_objects(tmp_path):
    votes = np.concatenate([_votes(NEAR, 3), _votes(FAR, 2), _votes(WRONG, 5)])
    (counted,) = _noted(tmp_path, **NO_POSE, votes=votes)[1].votes
    good = pytest.approx(np.linspace(1.0, 2.0, 10)[:5].sum())
    assert counted == VoteCounts(1, 10, 5, pytest.approx(15.0), good, 6, 4)
