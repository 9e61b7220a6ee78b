"""Turns about the axis of what is nearly of revolution, half turns, and which is chosen."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hlp.geometry import rigid, rotation_distance, transform
from hlp.refinement.choice import choose_among_alike
from hlp.refinement.pso import PsoSettings
from hlp.refinement.refiner import Refinement, turned_over
from hlp.refinement.turns import half_turns, turns_about_axis
from hlp.refinement.verification import VerificationSettings, Verifier, observe
from hlp.rendering.rasterizer import render_rgbd
from hlp.rendering.shading import FRONTAL_LIGHT
from refinement_scene import CAMERA, SHAPE, colorless, model_of

TURNED = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])
SETTINGS = VerificationSettings()


def mug():
    """A cylinder with a handle, whose axis is turned and away from the centre of its box."""
    body = trimesh.creation.cylinder(0.04, 0.09, sections=48)
    handle = trimesh.creation.box((0.02, 0.008, 0.03))
    handle.apply_translation([0.048, 0.0, 0.0])
    shape = trimesh.util.concatenate([body, handle])
    shape.apply_transform(TURNED)
    return shape


def test_turns_leave_the_axis_where_it_is():
    turns = turns_about_axis(model_of(mug()))
    np.testing.assert_array_equal(turns[0], np.eye(4))
    on_axis = transform(TURNED, np.array([[0.0, 0.0, -0.04], [0.0, 0.0, 0.04]]))
    for turn in turns:
        np.testing.assert_allclose(transform(turn, on_axis), on_axis, atol=1e-3)
    angles = np.degrees(rotation_distance(turns[:-1, :3, :3], turns[1:, :3, :3]))
    np.testing.assert_allclose(angles, 10.0, atol=1e-6)
    assert len(turns) == 36


def test_other_shapes_and_symmetric_ones_have_no_turns():
    identity = np.eye(4)[None]
    boxes = model_of(trimesh.creation.box((0.1, 0.06, 0.03)))
    round_one = model_of(mug())
    flipped = np.diag([1.0, -1.0, -1.0, 1.0])[None]
    symmetric = replace(round_one, symmetries=np.concatenate([identity, flipped]))
    printed = replace(round_one, near_symmetries=flipped)
    for model in (boxes, symmetric, printed):
        np.testing.assert_array_equal(turns_about_axis(model), identity)


@pytest.mark.parametrize("angle", [0.0, 50.0, 180.0])
def test_the_turn_with_the_handle_in_its_place_is_chosen(angle):
    verifier = Verifier(model_of(mug()), SETTINGS)
    upright = trimesh.transformations.rotation_matrix(2.2, [1, 0, 0])[:3, :3]
    true = rigid(upright, np.array([0.0, 0.0, 0.6])) @ np.linalg.inv(TURNED)
    rgb, depth = render_rgbd(verifier.mesh, true, CAMERA, SHAPE, FRONTAL_LIGHT)
    seen = observe(rgb, depth, CAMERA, SETTINGS)
    found = choose_among_alike(verifier, seen, true @ verifier.turns[round(angle / 10.0)])
    np.testing.assert_allclose(found, true, atol=1e-3)
    box = Verifier(model_of(trimesh.creation.box((0.1, 0.06, 0.03))), SETTINGS)
    assert choose_among_alike(box, seen, true) is true


def link():
    """A flat part without colours: a bar with a block at one end, thicker on one side."""
    bar = trimesh.creation.box((0.1, 0.03, 0.012))
    block = trimesh.creation.box((0.03, 0.04, 0.02))
    block.apply_translation([0.04, 0.0, 0.008])
    return colorless(model_of(trimesh.util.concatenate([bar, block])))


def test_half_turns_leave_the_bounding_box_where_it_is():
    """Those that are symmetries are left out, and all of an object with colours."""
    model = link()
    turns = half_turns(model)
    angles = np.degrees(rotation_distance(turns[:, :3, :3], np.eye(3)))
    np.testing.assert_allclose(angles, 180.0, atol=1e-6)
    vertices = model.mesh.vertices
    box = trimesh.bounds.corners(np.stack([vertices.min(axis=0), vertices.max(axis=0)]))
    for turn in turns:
        moved = transform(turn, box)
        np.testing.assert_allclose([moved.min(0), moved.max(0)], [box.min(0), box.max(0)])
    assert len(turns) == 3
    symmetric = replace(model, symmetries=np.concatenate([np.eye(4)[None], turns[:1]]))
    np.testing.assert_array_equal(half_turns(symmetric), turns[1:])
    assert len(half_turns(model_of(mug()))) == 0


def link_seen():
    """A verifier of the link, its pose, and what a camera sees of it."""
    verifier = Verifier(link(), SETTINGS)
    tilted = trimesh.transformations.rotation_matrix(2.6, [1, 0.3, 0])[:3, :3]
    true = rigid(tilted, np.array([0.0, 0.0, 0.5]))
    rgb, depth = render_rgbd(verifier.mesh, true, CAMERA, SHAPE, FRONTAL_LIGHT)
    return verifier, true, observe(rgb, np.where(depth > 0.0, depth, 0.6), CAMERA, SETTINGS)


@pytest.mark.parametrize("turned", [None, 0, 1, 2])
def test_an_answer_is_turned_over_where_that_is_clearly_better(turned):
    """Though the turned pose costs more before it is refined: the answer is at its own minimum."""
    verifier, true, seen = link_seen()
    refiner, start = PsoSettings().build(threads=1), true
    if turned is not None:
        given = Refinement(true @ verifier.half_turns[turned], 3)
        start = refiner.second_search(verifier.model, seen, given).pose_cam_obj
    found = turned_over(refiner, verifier, seen, start, seed=1)
    if turned is None:
        assert found is None
    else:
        assert found is not None
        before, after = verifier.costs(seen, np.stack([start, found.pose_cam_obj]))
        assert after < 0.8 * before
        assert np.degrees(rotation_distance(found.pose_cam_obj[:3, :3], true[:3, :3])) < 5.0


def test_what_has_no_half_turns_is_not_turned_over():
    verifier, true, seen = link_seen()
    verifier.half_turns = np.zeros((0, 4, 4))
    assert turned_over(PsoSettings().build(threads=1), verifier, seen, true, seed=1) is None
