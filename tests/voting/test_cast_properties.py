"""Votes of a codebook that holds exactly what is seen, for every view and ray."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from generated_values import motions, numbers, point_sets, rotations, vectors
from hlp.codebook.entries import make_codebook
from hlp.geometry import allocentric_to_egocentric, inverse, rigid, rotation_distance, transform
from hlp.records import LocalPatches, Matches, Mesh, ObjectModel
from hlp.voting.cast import canonical_rotations, cast_votes

FLOAT32 = 2e-6  # rounding of what a codebook stores, in metres and radians


def model_of(points, symmetries=None):
    count = len(points)
    flat = np.zeros((count, 3), np.uint8)
    mesh = Mesh(points, np.zeros((1, 3), np.int64), flat, np.zeros((count, 3)))
    symmetries = np.eye(4)[None] if symmetries is None else symmetries
    return ObjectModel(1, "thing", mesh, mesh, 0.1, symmetries, 0.1, 0.04)


def patches_at(points_cam):
    count = len(points_cam)
    none = np.zeros((count, 2, 2))
    pixels = np.zeros((count, 2))
    return LocalPatches(np.zeros((count, 2, 2, 0), np.uint8), none, none > 0, points_cam, pixels)


@st.composite
def exact_codebooks(draw):
    """A view with the centroid on the optical axis, and a codebook of all of its points."""
    points = draw(point_sets()) + draw(vectors(-0.1, 0.1))
    model = model_of(points)
    rotation = draw(rotations())
    view = rigid(rotation, [0.0, 0.0, draw(numbers(0.3, 2.0))] - rotation @ model.centroid)
    seen = transform(view, points)
    features = np.zeros((len(points), 1))
    codebook = make_codebook(1, features, seen, np.tile(view, (len(points), 1, 1)), 1.0)
    own = Matches(np.arange(len(points))[:, None], np.zeros((len(points), 1)))
    return model, view, seen, codebook, own


@given(exact_codebooks())
def test_every_point_of_a_view_votes_for_the_views_pose(case):
    model, view, seen, codebook, own = case
    votes = cast_votes(patches_at(seen), own, codebook, model, 1.0, True)
    centroid = view[:3, :3] @ model.centroid + view[:3, 3]
    assert len(votes) == len(seen)
    np.testing.assert_allclose(votes.centroids_cam, np.tile(centroid, (len(seen), 1)), atol=FLOAT32)
    assert rotation_distance(votes.rotations_cam_obj, view[:3, :3]).max() < FLOAT32
    np.testing.assert_array_equal(votes.weights, 1.0)


@given(exact_codebooks(), vectors(-1.0, 1.0, 2))
def test_a_view_seen_along_another_ray_is_voted_for_with_its_pose_there(case, direction):
    """Each patch, with the object around it, turned as its viewing ray is."""
    model, view, seen, codebook, own = case
    ray = np.array([*direction, 1.0])
    there = ray / np.linalg.norm(ray) * np.linalg.norm(seen, axis=1)[:, None]
    votes = cast_votes(patches_at(there), own, codebook, model, 1.0, True)
    turns = allocentric_to_egocentric(there) @ np.swapaxes(allocentric_to_egocentric(seen), 1, 2)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", turns, seen), there, atol=1e-9)
    poses = rigid(turns, np.zeros((len(turns), 3))) @ view
    centroids = transform(poses, np.tile(model.centroid, (len(turns), 1, 1)))[:, 0]
    np.testing.assert_allclose(votes.centroids_cam, centroids, atol=FLOAT32)
    assert rotation_distance(votes.rotations_cam_obj, poses[:, :3, :3]).max() < FLOAT32


@given(st.lists(rotations(), min_size=1, max_size=6), motions(0.05), st.integers(2, 8), st.data())
def test_symmetric_siblings_of_a_vote_become_one_vote(given_, place, order, data):
    turns = [Rotation.from_rotvec([0, 0, 2 * np.pi * i / order]).as_matrix() for i in range(order)]
    group = np.stack([place @ rigid(turn, np.zeros(3)) @ inverse(place) for turn in turns])
    votes = np.stack(given_)
    canonical = canonical_rotations(votes, group)
    sibling = group[data.draw(st.integers(0, order - 1)), :3, :3]
    again = canonical_rotations(votes @ sibling, group)
    alike = rotation_distance(canonical, again) < 1e-6
    # Where two siblings are equally near to the reference, either may be taken.
    reference = np.array([[1, 0, 0], [0, -(0.5**0.5), -(0.5**0.5)], [0, 0.5**0.5, -(0.5**0.5)]])
    near, near_again = (rotation_distance(each, reference) for each in (canonical, again))
    tied = np.abs(near - near_again) < 1e-6
    assert (alike | tied).all()
    nearest = rotation_distance((votes[:, None] @ group[None, :, :3, :3]), reference).min(axis=1)
    np.testing.assert_allclose(near, nearest, atol=1e-6)
