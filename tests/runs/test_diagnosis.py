"""Evidence from what stages leave on disk, written by hand for a frame rendered of true poses."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from hlp.evaluation.settings import EvaluationSettings, WaterfallSettings
from hlp.evaluation.waterfall import VoteCounts
from hlp.geometry import project, rigid, transform
from hlp.method.find.trace import STAGES, ObjectTrace
from hlp.records import (
    Frame,
    Hypotheses,
    Mesh,
    ObjectModel,
    Refinement,
    Region,
    Target,
    TargetScore,
    Votes,
)
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.pose_fit import PoseFit
from hlp.rendering.rasterizer import render_depth
from hlp.runs.diagnosis import explain_misses, note_frame, visible_pixels
from hlp.stages.trace_files import read_trace, write_trace

K = np.array([[570.0, 0.0, 80.0], [0.0, 570.0, 60.0], [0.0, 0.0, 1.0]])
SETTINGS = EvaluationSettings(
    "test", [], 0.1, 5.0, 5.0, 0.5, 100, WaterfallSettings(30, 30, 15, 20, 5, 0.25, 0.5, 0.1)
)
NEAR = rigid(Rotation.from_rotvec([0.4, 0.2, 0.1]).as_matrix(), np.array([-0.05, 0.0, 0.8]))
FAR = rigid(Rotation.from_rotvec([-0.4, 0.3, 0.0]).as_matrix(), np.array([0.06, 0.0, 0.9]))


def _model():
    box = trimesh.creation.box((0.06, 0.08, 0.10)).subdivide()
    vertices = np.array(box.vertices)
    colors = np.zeros((len(vertices), 3), np.uint8)
    mesh = Mesh(vertices, np.array(box.faces), colors, np.array(box.vertex_normals))
    diameter = float(np.linalg.norm([0.06, 0.08, 0.10]))
    return ObjectModel(1, "box", mesh, mesh, diameter, np.eye(4)[None], 0.08, 0.03)


MODEL = _model()


def _frame():
    """Two boxes before a wall at 1.5 m."""
    rendered = render_depth(MODEL.mesh, np.stack([NEAR, FAR]), K, (120, 160))
    depth = np.where(rendered > 0, rendered, 1.5).min(axis=0)
    targets = (Target(1, NEAR, 1.0), Target(1, FAR, 1.0))
    return Frame(6, 3, np.zeros((120, 160, 3), np.uint8), depth, K, targets)


FRAME = _frame()
TARGET = FRAME.targets[0]
SOURCE = SimpleNamespace()
CENTERS = np.rint(project(np.stack([NEAR[:3, 3], FAR[:3, 3]]), K)).astype(np.int16)
PIXELS = np.concatenate(
    [CENTERS, CENTERS, np.zeros((2, 2), np.int16), CENTERS, np.zeros((2, 2), np.int16)]
)
"""Centres (x, y) of the patches that vote: on the boxes, and in the corner of the picture."""


def _moved(pose, degrees, metres):
    turn = Rotation.from_rotvec(np.deg2rad([0.0, degrees, 0.0])).as_matrix()
    moved = pose.copy()
    moved[:3, :3] = pose[:3, :3] @ turn
    moved[:3, 3] += [metres, 0.0, 0.0]
    return moved


def _detection(folder, frame, mask, coarse, refined, sources, votes):
    """A detection whose stages have left these: `refined` poses, the first of them the answer."""
    grid = np.stack(np.meshgrid(np.arange(0, 160, 8), np.arange(0, 120, 8)), -1).reshape(-1, 2)
    kept = frame.depth[grid[:, 1], grid[:, 0]] > 0
    poses, count = np.reshape(coarse, (-1, 4, 4)), len(refined)
    fine = RefinedHypotheses(
        [Refinement(pose, 0) for pose in refined],
        np.zeros(count),
        np.array(sources),
        np.zeros((count, 2), dtype=int),
        (0,),
    )
    found = ObjectTrace(
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
    for stage in STAGES:
        (folder / stage).mkdir()
        write_trace(folder / stage, frame.key, stage, {1: found})
    outputs = {
        stage: (lambda folder=folder / stage: SimpleNamespace(folder=folder)) for stage in STAGES
    }
    dataset = SimpleNamespace(models={1: MODEL}, frames=SOURCE, wanted=lambda frame: {1: 1})
    return SimpleNamespace(dataset=dataset, **outputs)


def _notes(detection, frame=FRAME):
    """What is counted in the frame, from what the stages have left on disk."""
    folders = {stage: getattr(detection, stage)().folder for stage in STAGES}
    return note_frame(detection.dataset, frame, read_trace(folders, frame.key), SETTINGS)


def _explained(detection, scores, frame=FRAME):
    return explain_misses(detection, [_notes(detection, frame)], scores, SETTINGS)


def _missed():
    return TargetScore(6, 3, 1, True, 1.0, 0.1, 1.0, 0.1, 0.5, False, False, False)


def _votes(pose, count):
    return np.stack([_moved(pose, 4.0, 0.002 * i) for i in range(count)])


WRONG = _moved(NEAR, 90.0, 0.2)
CLOSE = _moved(NEAR, 20.0, 0.01)
EVERYWHERE = np.ones((120, 160), dtype=bool)


@pytest.mark.parametrize(
    ("cause", "changed"),
    [
        ("ranking", {}),
        ("refiner_diverged", {"refined": [WRONG, WRONG]}),
        ("screening", {"refined": [WRONG], "sources": [1]}),
        ("outside_basin", {"coarse": [WRONG, WRONG], "refined": [WRONG, WRONG]}),
        ("few_votes", {"coarse": [], "refined": [], "votes": _votes(NEAR, 4)}),
        ("wrong_region", {"coarse": [], "refined": [], "mask": ~EVERYWHERE}),
    ],
)
def test_what_the_stages_left_tells_the_cause(tmp_path, cause, changed):
    left = {
        "mask": EVERYWHERE,
        "coarse": [CLOSE, WRONG],
        "refined": [WRONG, NEAR],
        "sources": [1, 0],
        "votes": _votes(NEAR, 6),
    }
    detection = _detection(tmp_path, FRAME, **{**left, **changed})
    right = dataclasses.replace(_missed(), add_correct=True)
    explained = _explained(detection, [_missed(), right])
    assert [score.cause for score in explained] == [cause, ""]
    assert explained[0] == dataclasses.replace(_missed(), cause=cause)


def test_each_target_of_an_object_has_its_own_cause(tmp_path):
    detection = _detection(tmp_path, FRAME, EVERYWHERE, [CLOSE], [WRONG], [0], _votes(FAR, 6))
    explained = _explained(detection, [_missed(), _missed()])
    assert [score.cause for score in explained] == ["refiner_diverged", "outside_basin"]


def test_an_answer_on_the_surface_the_wrong_way_round_is_a_flip(tmp_path):
    flipped = _moved(NEAR, 180.0, 0.0)
    detection = _detection(
        tmp_path, FRAME, EVERYWHERE, [CLOSE], [flipped, NEAR], [0, 0], _votes(NEAR, 6)
    )
    (score, _) = _explained(detection, [_missed(), _missed()])
    assert score.cause == "symmetric_flip"


def test_missing_depth_and_missing_windows(tmp_path):
    shown = visible_pixels(SOURCE, FRAME, TARGET, MODEL)
    blind = dataclasses.replace(FRAME, depth=np.where(shown, 0.0, FRAME.depth))
    (tmp_path / "a").mkdir()
    detection = _detection(tmp_path / "a", blind, ~EVERYWHERE, [], [], [], _votes(NEAR, 4))
    assert _explained(detection, [_missed(), _missed()], blind)[0].cause == "depth_missing"
    hidden = dataclasses.replace(FRAME, depth=np.full_like(FRAME.depth, 0.3))
    (tmp_path / "b").mkdir()
    detection = _detection(tmp_path / "b", hidden, EVERYWHERE, [], [], [], _votes(NEAR, 6))
    assert _explained(detection, [_missed(), _missed()], hidden)[0].cause == "no_window"


def test_visible_is_what_nothing_else_hides():
    own = render_depth(MODEL.mesh, NEAR[None], K, (120, 160))[0] > 0
    assert (visible_pixels(SOURCE, FRAME, TARGET, MODEL) == own).all()
    depth = FRAME.depth.copy()
    depth[:, :60] = 0.5  # something stands before the left part
    depth[:, 60:64] = 0.0  # unknown
    shown = visible_pixels(SOURCE, dataclasses.replace(FRAME, depth=depth), TARGET, MODEL)
    assert 0 < shown.sum() < own.sum()
    assert (shown[:, 60:] == own[:, 60:]).all() and not shown[:, :60].any()


def test_the_data_sets_own_mask_is_taken_where_it_has_one():
    given = FRAME.depth < 1.0
    source = SimpleNamespace(visible_mask=lambda frame, target: given)
    assert visible_pixels(source, FRAME, TARGET, MODEL) is given
    source.visible_mask = lambda frame, target: None
    own = render_depth(MODEL.mesh, NEAR[None], K, (120, 160))[0] > 0
    assert (visible_pixels(source, FRAME, TARGET, MODEL) == own).all()


def test_votes_near_either_target_are_good_and_those_on_either_are_the_objects(tmp_path):
    votes = np.concatenate([_votes(NEAR, 3), _votes(FAR, 2), _votes(WRONG, 5)])
    detection = _detection(tmp_path, FRAME, EVERYWHERE, [], [], [], votes)
    (counted,) = _notes(detection).votes
    weights = np.linspace(1.0, 2.0, 10)
    assert counted == VoteCounts(
        1, 10, 5, pytest.approx(15.0), pytest.approx(weights[:5].sum()), 6, 4
    )
