"""Votes beside a slow loop, and those of a codebook that holds exactly what is seen."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from generated_values import motions, numbers, point_sets, rotations, turns_about_z, vectors
from hlp.codebook.entries import make_codebook
from hlp.geometry import allocentric_to_egocentric, inverse, rigid, rotation_distance, transform
from hlp.records import Codebook, LocalPatches, Matches, Mesh, ObjectModel
from hlp.voting.cast import canonical_rotations, cast_votes

FLOAT32 = 2e-6  # rounding of what a codebook stores, in metres and radians


def model_of(points):
    flat = np.zeros(points.shape, np.uint8)
    mesh = Mesh(points, np.zeros((1, 3), np.int64), flat, np.zeros(points.shape))
    return ObjectModel(1, "thing", mesh, mesh, 0.1, np.eye(4)[None], 0.1, 0.04)


MODEL = model_of(np.array([[0.01, 0.02, -0.03], [0.06, -0.05, 0.02]]))


def patches_at(points_cam):
    count = len(points_cam)
    empty = np.zeros((count, 4, 4))
    pixels = np.arange(2.0 * count).reshape(count, 2)
    color = np.zeros((count, 4, 4, 3), np.uint8)
    return LocalPatches(color, empty, empty > 0, np.asarray(points_cam), pixels)


def random_case(patches=12, entries=20, neighbours=3):
    rng = np.random.default_rng(0)
    points = np.array([0.0, 0.0, 0.9]) + rng.uniform(-0.3, 0.3, (patches, 3))
    rotations = Rotation.random(entries, random_state=0).as_matrix().astype(np.float32)
    offsets = rng.uniform(-0.1, 0.1, (entries, 3)).astype(np.float32)
    codebook = Codebook(1, np.zeros((entries, 2), np.float32), rotations, offsets, 0.4)
    indices = rng.integers(entries, size=(patches, neighbours))
    distances = np.sort(rng.uniform(0.0, 1.0, (patches, neighbours)), axis=1)
    return patches_at(points), Matches(indices, distances), codebook


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("limit", [0.5, 1.5, 9.0])
def test_votes_equal_a_slow_loop(weighted, limit):
    patches, matches, codebook = random_case()
    of_patch = np.linspace(0.1, 1.0, len(patches)) if weighted else np.ones(len(patches))
    factors = of_patch if weighted else None
    votes = cast_votes(patches, matches, codebook, MODEL, limit, weighted, factors)
    expected = []
    for i, point in enumerate(patches.points_cam):
        ray = point / np.linalg.norm(point)
        axis = np.cross([0.0, 0.0, 1.0], ray)
        angle = np.arccos(ray[2])
        turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
        for entry, distance in zip(matches.indices[i], matches.distances[i], strict=True):
            if distance > limit * 0.4:
                continue
            rotation = turn @ codebook.rotations_cam_obj[entry]
            centroid = point + rotation @ (MODEL.centroid - codebook.points_obj[entry])
            weight = np.exp(-((distance / 0.4) ** 2) / 2) if weighted else 1.0
            expected.append((centroid, rotation, weight * of_patch[i], i, patches.pixels[i]))
    assert 0 < len(expected) == len(votes)
    centroids, rotations, weights, rows, pixels = (
        np.array(part) for part in zip(*expected, strict=True)
    )
    np.testing.assert_allclose(votes.centroids_cam, centroids, atol=1e-9)
    np.testing.assert_allclose(votes.rotations_cam_obj, rotations, atol=1e-9)
    np.testing.assert_allclose(votes.weights, weights, atol=1e-12)
    np.testing.assert_array_equal(votes.patches, rows)
    np.testing.assert_array_equal(votes.pixels, pixels)


def test_without_near_neighbours_or_patches_there_are_no_votes():
    patches, matches, codebook = random_case()
    assert len(cast_votes(patches, matches, codebook, MODEL, -1.0, True)) == 0
    none = Matches(np.zeros((0, 3), int), np.zeros((0, 3)))
    assert len(cast_votes(patches_at(np.zeros((0, 3))), none, codebook, MODEL, 3.0, True)) == 0


def test_nearby_upright_poses_of_a_symmetric_object_have_nearby_canonical_rotations():
    symmetries = turns_about_z(315)
    rng = np.random.default_rng(0)
    for elevation in (20.0, 45.0, 75.0):  # of the camera above the table
        upright = Rotation.from_euler("x", -90.0 - elevation, degrees=True)
        spin = Rotation.from_rotvec(rng.uniform(0, 6.28, (50, 1)) * [0.0, 0.0, 1.0])
        tilt = Rotation.from_rotvec(np.deg2rad(2.0) * rng.normal(size=(50, 3)) / np.sqrt(3))
        named = canonical_rotations((tilt * upright * spin).as_matrix(), symmetries)
        assert np.rad2deg(rotation_distance(named, named[0])).max() < 12.0


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
    np.testing.assert_array_equal(votes.weights, 1.0)


@given(st.lists(rotations(), min_size=1, max_size=6), motions(0.05), st.integers(2, 8), st.data())
def test_symmetric_siblings_of_a_vote_become_one_vote(given_, place, order, data):
    group = place @ turns_about_z(order) @ inverse(place)
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
