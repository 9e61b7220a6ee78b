import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.codebook.entries import make_codebook
from hlp.data.synthetic.objects import demo_objects
from hlp.geometry import rigid, rotation_distance
from hlp.patches.local import LocalSettings, cut_local_patches
from hlp.records import Codebook, LocalPatches, Matches
from hlp.rendering.light import random_light
from hlp.rendering.rasterizer import render_rgbd
from hlp.voting.cast import canonical_rotations, cast_votes

OFFSET = np.array([0.01, 0.0, -0.02])


@pytest.fixture(scope="module")
def model():
    """A demo object, not symmetric, moved away from its coordinates' origin."""
    demo = next(iter(demo_objects().values()))
    moved = dataclasses.replace(demo.mesh, vertices=demo.mesh.vertices + OFFSET)
    return dataclasses.replace(demo, mesh=moved)


def patches_at(points_cam):
    count = len(points_cam)
    empty = np.zeros((count, 4, 4))
    pixels = np.arange(2.0 * count).reshape(count, 2)
    color = np.zeros((count, 4, 4, 3), np.uint8)
    return LocalPatches(color, empty, empty > 0, np.asarray(points_cam), pixels)


def random_case(seed=0, patches=12, entries=20, neighbours=3):
    rng = np.random.default_rng(seed)
    points = np.array([0.0, 0.0, 0.9]) + rng.uniform(-0.3, 0.3, (patches, 3))
    codebook = Codebook(
        1,
        np.zeros((entries, 2), np.float32),
        Rotation.random(entries, random_state=seed).as_matrix().astype(np.float32),
        rng.uniform(-0.1, 0.1, (entries, 3)).astype(np.float32),
        0.4,
    )
    indices = rng.integers(entries, size=(patches, neighbours))
    distances = np.sort(rng.uniform(0.0, 1.0, (patches, neighbours)), axis=1)
    return patches_at(points), Matches(indices, distances), codebook


@pytest.mark.parametrize("weighted_by_distance", [False, True])
@pytest.mark.parametrize("limit", [0.5, 1.5, 9.0])
def test_votes_equal_a_slow_loop(model, weighted_by_distance, limit):
    patches, matches, codebook = random_case()
    votes = cast_votes(patches, matches, codebook, model, limit, weighted_by_distance)
    expected = []
    for i, point in enumerate(patches.points_cam):
        ray = point / np.linalg.norm(point)
        axis = np.cross([0.0, 0.0, 1.0], ray)
        turn = Rotation.from_rotvec(
            axis / np.linalg.norm(axis) * np.arccos(ray[2])
        ).as_matrix()  # fmt: skip
        for entry, distance in zip(matches.indices[i], matches.distances[i], strict=True):
            if distance > limit * 0.4:
                continue
            rotation = turn @ codebook.rotations_cam_obj[entry]
            centroid = point + rotation @ (model.centroid - codebook.points_obj[entry])
            weight = np.exp(-((distance / 0.4) ** 2) / 2) if weighted_by_distance else 1.0
            expected.append((centroid, rotation, weight, i, patches.pixels[i]))
    assert 0 < len(expected) == len(votes)
    centroids, rotations, weights, rows, pixels = (
        np.array(part) for part in zip(*expected, strict=True)
    )
    np.testing.assert_allclose(votes.centroids_cam, centroids, atol=1e-9)
    np.testing.assert_allclose(votes.rotations_cam_obj, rotations, atol=1e-9)
    np.testing.assert_allclose(votes.weights, weights, atol=1e-12)
    np.testing.assert_array_equal(votes.patches, rows)
    np.testing.assert_array_equal(votes.pixels, pixels)


def test_patch_weights_multiply_the_votes_of_their_patch(model):
    patches, matches, codebook = random_case(4)
    plain = cast_votes(patches, matches, codebook, model, 3.0, True)
    patch_weights = np.linspace(0.1, 1.0, len(patches))
    weighted_by_region = cast_votes(patches, matches, codebook, model, 3.0, True, patch_weights)
    np.testing.assert_allclose(
        weighted_by_region.weights, plain.weights * patch_weights[plain.patches]
    )
    np.testing.assert_array_equal(weighted_by_region.centroids_cam, plain.centroids_cam)


def test_without_near_neighbours_or_patches_there_are_no_votes(model):
    patches, matches, codebook = random_case()
    assert len(cast_votes(patches, matches, codebook, model, -1.0, True)) == 0
    none = Matches(np.zeros((0, 3), int), np.zeros((0, 3)))
    assert len(cast_votes(patches_at(np.zeros((0, 3))), none, codebook, model, 3.0, True)) == 0


CAMERA = np.array([[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]])
SHAPE = (241, 321)
LOCAL = LocalSettings(32, 1.0, True)


def seen(model, pose):
    light = random_light(np.random.default_rng(0))
    return render_rgbd(model.mesh, pose, CAMERA, SHAPE, light)


def centred_view(model, seed):
    """A view as the codebook's: the centroid lies on the optical axis."""
    rotation = Rotation.random(random_state=seed).as_matrix()
    return rigid(rotation, np.array([0.0, 0.0, 0.7]) - rotation @ model.centroid)


@pytest.mark.parametrize("pixel", [(160, 120), (30, 30), (290, 200), (160, 20), (300, 120)])
@pytest.mark.parametrize("seed", [0, 1])
def test_an_object_rendered_off_centre_is_voted_for_with_its_exact_pose(model, pixel, seed):
    # The camera is turned away from a view, so that the view's middle is seen at `pixel`.
    view = centred_view(model, seed)
    ray = np.linalg.inv(CAMERA) @ [*pixel, 1.0]
    turn, _ = Rotation.align_vectors([ray / np.linalg.norm(ray)], [[0.0, 0.0, 1.0]])
    pose = rigid(turn.as_matrix(), np.zeros(3)) @ view
    rgb, depth = seen(model, view)
    middle = np.array([[160, 120]])
    entry = cut_local_patches(rgb, depth, CAMERA, middle, model.local_size, LOCAL, 0.0)
    codebook = make_codebook(model.object_id, np.zeros((1, 4)), entry.points_cam, view[None], 1.0)
    rgb, depth = seen(model, pose)
    cut = cut_local_patches(rgb, depth, CAMERA, np.array([pixel]), model.local_size, LOCAL, 0.0)
    matches = Matches(np.zeros((1, 1), int), np.zeros((1, 1)))
    votes = cast_votes(cut, matches, codebook, model, 1.0, weighted_by_distance=True)
    centroid = pose[:3, :3] @ model.centroid + pose[:3, 3]
    # The patch's depth is a median over 3 x 3 pixels, in the view and here: up to a pixel apart.
    np.testing.assert_allclose(votes.centroids_cam[0], centroid, atol=0.0025)
    assert np.rad2deg(rotation_distance(votes.rotations_cam_obj[0], pose[:3, :3])) < 0.01


def spun(symmetries, seed=0):
    """One pose of a symmetric object, named in all the ways that look alike."""
    rotation = Rotation.random(random_state=seed).as_matrix()
    return rotation @ symmetries[:, :3, :3]


def symmetries_about_z(count):
    turns = np.arange(count)[:, None] * [0.0, 0.0, 2 * np.pi / count]
    return rigid(Rotation.from_rotvec(turns).as_matrix(), np.zeros(3))


@pytest.mark.parametrize("count", [2, 72])
@pytest.mark.parametrize("seed", range(5))
def test_rotations_that_look_alike_get_one_name(count, seed):
    symmetries = symmetries_about_z(count)
    alike = spun(symmetries, seed)
    named = canonical_rotations(alike, symmetries)
    assert rotation_distance(named, named[0]).max() < 1e-6
    # … which is one of their own names
    assert rotation_distance(alike, named[0]).min() < 1e-6


def test_nearby_upright_poses_of_a_symmetric_object_have_nearby_canonical_rotations():
    symmetries = symmetries_about_z(315)
    rng = np.random.default_rng(0)
    for elevation in (20.0, 45.0, 75.0):  # of the camera above the table
        upright = Rotation.from_euler("x", -90.0 - elevation, degrees=True)
        spin = Rotation.from_rotvec(rng.uniform(0, 6.28, (50, 1)) * [0.0, 0.0, 1.0])
        tilt = Rotation.from_rotvec(np.deg2rad(2.0) * rng.normal(size=(50, 3)) / np.sqrt(3))
        named = canonical_rotations((tilt * upright * spin).as_matrix(), symmetries)
        assert np.rad2deg(rotation_distance(named, named[0])).max() < 12.0


def test_rotations_of_an_object_without_symmetries_stay_as_they_are():
    rotations = Rotation.random(5, random_state=0).as_matrix()
    np.testing.assert_array_equal(canonical_rotations(rotations, np.eye(4)[None]), rotations)


def test_votes_of_a_symmetric_object_agree_on_the_rotation(model):
    symmetric = dataclasses.replace(model, symmetries=symmetries_about_z(36))
    view = centred_view(model, 0)
    rotations = view[:3, :3] @ symmetric.symmetries[:, :3, :3]
    points = np.tile([0.0, 0.0, 0.7], (36, 1))
    features = np.zeros((36, 2))
    poses = rigid(rotations, points - rotations @ model.centroid)
    codebook = make_codebook(model.object_id, features, points, poses, 1.0)
    matches = Matches(np.arange(36)[:, None], np.zeros((36, 1)))
    votes = cast_votes(
        patches_at(points), matches, codebook, symmetric, 1.0, weighted_by_distance=False
    )
    assert rotation_distance(votes.rotations_cam_obj, votes.rotations_cam_obj[0]).max() < 1e-5
    np.testing.assert_allclose(votes.centroids_cam, points, atol=1e-6)
