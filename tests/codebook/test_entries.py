import numpy as np
from scipy.spatial.transform import Rotation

from hlp.codebook.entries import make_codebook
from hlp.data.synthetic.objects import demo_objects
from hlp.geometry import rigid, rotation_distance
from hlp.records import LocalPatches, Matches
from hlp.voting.cast import cast_votes

COUNT = 40


def make_entries(seed=0):
    """Codebook entries of random views, and the patches they were made of."""
    rng = np.random.default_rng(seed)
    rotations = Rotation.random(COUNT, random_state=seed).as_matrix()
    translations = np.array([0.02, 0.01, 0.7]) + rng.uniform(-0.05, 0.05, (COUNT, 3))
    poses = rigid(rotations, translations)
    points_obj = rng.uniform(-0.05, 0.05, (COUNT, 3))
    points_cam = np.einsum("mij,mj->mi", rotations, points_obj) + translations
    features = rng.normal(size=(COUNT, 6))
    return make_codebook(9, features, points_cam, poses, 0.5), poses, points_cam, points_obj


def test_entries_know_their_point_on_the_object():
    codebook, _, _, points_obj = make_entries()
    np.testing.assert_allclose(codebook.points_obj, points_obj, atol=1e-6)
    assert codebook.object_id == 9 and codebook.feature_scale == 0.5


def test_seen_again_in_its_own_view_an_entry_votes_for_exactly_that_views_pose():
    codebook, poses, points_cam, _ = make_entries()
    model = next(iter(demo_objects().values()))
    empty = np.zeros((COUNT, 4, 4))
    patches = LocalPatches(
        np.zeros((COUNT, 4, 4, 3), np.uint8), empty, empty > 0, points_cam, np.zeros((COUNT, 2))
    )
    matches = Matches(np.arange(COUNT)[:, None], np.zeros((COUNT, 1)))
    votes = cast_votes(patches, matches, codebook, model, 1.0, weighted_by_distance=False)
    expected = poses[:, :3, :3] @ model.centroid + poses[:, :3, 3]
    np.testing.assert_allclose(votes.centroids_cam, expected, atol=1e-6)
    assert rotation_distance(votes.rotations_cam_obj, poses[:, :3, :3]).max() < 1e-6


def test_rotations_are_stored_relative_to_the_viewing_ray():
    codebook, poses, points_cam, _ = make_entries()
    # Along the ray the object is seen from the same side, whatever the entry's place in the view.
    towards_camera = -points_cam / np.linalg.norm(points_cam, axis=1, keepdims=True)
    seen_from = np.einsum("mji,mj->mi", poses[:, :3, :3], towards_camera)
    stored = np.einsum("mji,j->mi", codebook.rotations_cam_obj, [0.0, 0.0, -1.0])
    np.testing.assert_allclose(stored, seen_from, atol=1e-6)
