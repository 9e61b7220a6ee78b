"""Coarse poses that follow from an answer: beside it, or several within it."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid, transform
from hlp.method.find.related_poses import poses_beside, poses_within
from packed_boxes import PAIR, PAIR_WHOLE, POSES, WHITE, box, frame, seen_as, verifier_of
from refinement_scene import CAMERA, SHAPE


def test_neighbours_touch_and_those_in_the_air_are_left_out():
    verifier = box()
    seen = frame(verifier, WHITE, WHITE, WHITE, WHITE).observation
    beside = poses_beside(verifier, seen, POSES[1:2], POSES[1:2]).poses_cam_obj
    for place in (0, 2, 3):
        assert np.abs(beside - POSES[place]).max(axis=(1, 2)).min() < 1e-6
    assert len(beside) < 6 and not (np.abs(beside - POSES[1]).max(axis=(1, 2)) < 0.01).any()
    alone = frame(verifier, (0, 0, 0)).observation
    assert len(poses_beside(verifier, alone, POSES[:1], POSES[:1])) < 3
    others = poses_beside(verifier, seen, POSES[1:2], POSES[1:3]).poses_cam_obj
    assert len(others) == len(beside) - 1
    assert np.abs(others - POSES[2]).max(axis=(1, 2)).min() > 0.05


def corners(verifier, pose):
    """The box's corners (m), in an order that its symmetries do not change."""
    found = np.round(transform(pose, verifier.mesh.vertices), 6)
    return found[np.lexsort(found.T)]


def test_two_parts_side_by_side_are_seen_within_what_was_taken_for_one():
    """By the edge between them: without it, or for a box of another shape, there is one."""
    sizes, dark = (0.04, 0.1, 0.08), (150, 150, 150)
    verifier = box(sizes)
    seen = frame(verifier, WHITE, dark, poses=PAIR).observation
    parts = poses_within(verifier, seen, PAIR_WHOLE)
    assert len(parts) == 2
    for true, found in zip(PAIR, parts, strict=True):
        apart = [np.abs(corners(verifier, pose) - corners(verifier, true)).max() for pose in found]
        assert max(apart) < 1e-6
    plain = frame(verifier, WHITE, WHITE, poses=PAIR).observation
    assert poses_within(verifier, plain, PAIR_WHOLE) == []
    other = box((0.06, 0.1, 0.08))
    assert poses_within(other, seen, PAIR_WHOLE) == []


@pytest.mark.parametrize(
    ("places", "whole_at", "off"),
    [((-0.036, 0.036, 0.0), 0.004, 0.012), ((-0.018, 0.018), 0.0115, 0.02)],
)
def test_parts_are_seen_within_one_that_they_do_not_fill(places, whole_at, off):
    """Three, of which it covers most: their size is an eighth larger, their edges are elsewhere.

    Or two, which it covers with what is beside them: they may be smaller by up to three tenths.
    """
    verifier = box((0.036, 0.1, 0.095))
    row = rigid(np.eye(3), np.array([[x, 0.0, 0.8] for x in places]))
    # The last one is drawn over the sides of the others.
    colors = [WHITE] * (len(row) - 1)
    seen = frame(verifier, *colors, (150, 150, 150), poses=row).observation
    whole = PAIR_WHOLE.copy()
    whole[:3, 3] = whole_at, 0.0, 0.8 - (0.095 - 0.036) / 2
    parts = poses_within(verifier, seen, whole)
    assert len(parts) == len(row)
    for true in row:
        apart = [np.linalg.norm(found[:, :3, 3] - true[:3, 3], axis=1).max() for found in parts]
        assert min(apart) < off
    plain = frame(verifier, *colors, WHITE, poses=row).observation
    assert poses_within(verifier, plain, whole) == []


def test_where_the_model_has_a_groove_an_edge_is_its_own():
    seen = frame(box((0.04, 0.1, 0.08)), WHITE, (150, 150, 150), poses=PAIR).observation
    shapes = [
        trimesh.creation.box((0.04, 0.1, 0.039)).apply_translation((0.0, 0.0, -0.0205)),
        trimesh.creation.box((0.04, 0.1, 0.039)).apply_translation((0.0, 0.0, 0.0205)),
        trimesh.creation.box((0.03, 0.1, 0.08)).apply_translation((-0.005, 0.0, 0.0)),
    ]
    assert poses_within(verifier_of(trimesh.util.concatenate(shapes)), seen, PAIR_WHOLE) == []
    assert poses_within(verifier_of(trimesh.creation.box((0.04, 0.1, 0.08))), seen, PAIR_WHOLE)


@pytest.mark.parametrize(("turn", "parts"), [(0.0, 2), (3.5, 2), (-3.5, 2), (12.0, 0)])
def test_the_edge_may_be_a_little_askew(turn, parts):
    """As it is where one was found that is turned a little against the two (degrees)."""
    verifier = box((0.04, 0.1, 0.08))
    seen = frame(verifier, WHITE, (150, 150, 150), poses=PAIR).observation
    whole = PAIR_WHOLE.copy()
    whole[:3, :3] = Rotation.from_euler("z", turn, degrees=True).as_matrix() @ whole[:3, :3]
    assert len(poses_within(verifier, seen, whole)) == parts


@pytest.mark.parametrize("share", [0.85, 1.0])
def test_the_edge_must_be_nearly_as_long_as_the_face(share):
    """Print rarely is."""
    verifier = box((0.04, 0.1, 0.08))
    context = frame(verifier, WHITE, WHITE, poses=PAIR)
    rgb = context.frame.rgb
    rows = np.flatnonzero((rgb == WHITE).all(axis=2).any(axis=1))
    columns = np.flatnonzero((rgb == WHITE).all(axis=2).any(axis=0))
    kept = rows[: round(share * len(rows))]
    rgb[kept[0] : kept[-1] + 1, int(columns.mean()) : int(columns.mean()) + 3] = 60
    seen = seen_as(rgb, context.observation.depth).observation
    assert len(poses_within(verifier, seen, PAIR_WHOLE)) == (2 if share == 1.0 else 0)


@pytest.mark.parametrize(("share", "parts"), [(0.2, 0), (0.5, 2)])
def test_of_a_face_that_the_image_cuts_off_enough_must_be_seen(share, parts):
    verifier = box((0.04, 0.1, 0.08))
    below = np.eye(4)
    nearest = PAIR_WHOLE[2, 3] - 0.02
    below[1, 3] = (SHAPE[0] - CAMERA[1, 2]) / CAMERA[1, 1] * nearest + 0.05 - 0.1 * share
    seen = frame(verifier, WHITE, (150, 150, 150), poses=below @ PAIR).observation
    assert len(poses_within(verifier, seen, below @ PAIR_WHOLE)) == parts
