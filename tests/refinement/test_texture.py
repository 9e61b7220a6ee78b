"""Choice among near symmetries by texture, on synthetic scenes with exact poses."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from generated_values import turns_about_z
from hlp.geometry import rigid, rotation_distance
from hlp.records import Mesh, ObjectModel, Texture
from hlp.refinement import texture
from hlp.refinement.texture import (
    ColorAgreement,
    LogarithmGrid,
    SeenSurface,
    choose_by_texture,
    choose_nearby_by_texture,
    color_agreement,
    sum_color_differences,
)
from hlp.refinement.verification import VerificationSettings, observe
from hlp.rendering.rasterizer import render_scene
from hlp.rendering.shading import Light
from hlp.rendering.surface import color_grid
from refinement_scene import as_mesh, colorless, model_of

CAMERA = np.array([[520.0, 0.0, 159.5], [0.0, 520.0, 119.5], [0.0, 0.0, 1.0]])
SHAPE = (240, 320)
HALF_TURNS = [np.diag([*signs, 1.0]) for signs in ([-1, -1, 1], [1, -1, -1], [-1, 1, -1])]
LIGHT = Light(direction=(0.3, -0.5, -0.8), ambient=0.4, diffuse=0.6, specular=0.2, shininess=15.0)


def _model(shape, near_symmetries):
    """A finely divided shape (m) with smooth random colours on its vertices."""
    fine = trimesh.Trimesh(*trimesh.remesh.subdivide_to_size(shape.vertices, shape.faces, 0.006))
    points = np.array(fine.vertices)
    waves = np.random.default_rng(5).normal(scale=60.0, size=(3, 3))
    colors = 120 + 80 * np.sin(points @ waves + [0.3, 1.1, 2.0])
    mesh = replace(as_mesh(fine), colors=colors.astype(np.uint8))
    model = model_of(shape)
    return replace(model, mesh=mesh, proxy=mesh, near_symmetries=np.stack(near_symmetries))


BOX = _model(trimesh.creation.box((0.06, 0.10, 0.15)), HALF_TURNS)
CARTON = _model(trimesh.creation.box((0.12, 0.08, 0.05)), HALF_TURNS)


def _scene(model, seed, hidden=False):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    pose = rigid(turn, np.array([0.01, -0.02, 0.6]))
    parts = [(model.mesh, pose)]
    if hidden:
        cover = as_mesh(trimesh.creation.box((0.05, 0.2, 0.02)), (200, 200, 200))
        parts.append((cover, rigid(np.eye(3), np.array([0.03, -0.02, 0.45]))))
    rgb, depth, _ = render_scene(parts, CAMERA, SHAPE, LIGHT)
    tinted = rgb * np.array([1.1, 0.95, 0.8]) * 0.8 + rng.normal(scale=4.0, size=rgb.shape)
    noisy = (depth + rng.normal(scale=0.002, size=SHAPE) * (depth > 0)).astype(np.float32)
    image = np.clip(tinted, 0, 255).astype(np.uint8)
    return pose, observe(image, noisy, CAMERA, VerificationSettings())


def _disturbed(pose, seed):
    rng = np.random.default_rng(100 + seed)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.radians(2.0)).as_matrix()
    return rigid(turn @ pose[:3, :3], pose[:3, 3] + rng.normal(scale=0.001, size=3))


def _off(found, pose):
    """The angle between two poses, in degrees."""
    return np.degrees(rotation_distance(found[:3, :3], pose[:3, :3]))


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize("seed", range(2))
def test_the_flip_that_the_colours_show_is_chosen(seed, hidden):
    pose, observation = _scene(BOX, seed, hidden)
    for motion in [np.eye(4), *HALF_TURNS]:
        start = _disturbed(pose, seed) @ motion
        assert _off(choose_by_texture(observation, BOX, start), pose) < 3.0


def _round_model():
    """A cylinder that looks alike by depth in steps of 5° about its axis."""
    cylinder = trimesh.creation.cylinder(0.035, 0.12, sections=48)
    return _model(cylinder, turns_about_z(72)[1:])


def test_the_angle_about_an_axis_is_found_to_a_few_degrees():
    model = _round_model()
    for seed, angle in ((0, 47.0), (1, 122.0), (2, -88.5)):
        pose, observation = _scene(model, seed)
        turned = Rotation.from_rotvec([0, 0, np.radians(angle)]).as_matrix()
        chosen = choose_by_texture(observation, model, pose @ rigid(turned, np.zeros(3)))
        assert _off(chosen, pose) < 4.0


def test_a_tracked_pose_turns_by_a_few_steps_and_not_by_half_a_turn():
    model = _round_model()
    pose, observation = _scene(model, 0)
    for angle, near in ((13.0, True), (-22.0, True), (180.0, False)):
        turned = rigid(Rotation.from_rotvec([0, 0, np.radians(angle)]).as_matrix(), np.zeros(3))
        wrong = _off(choose_nearby_by_texture(observation, model, pose @ turned), pose)
        assert wrong < 4.0 if near else wrong > 140.0
    pose, observation = _scene(BOX, 0)
    flipped = pose @ HALF_TURNS[0]
    assert choose_nearby_by_texture(observation, BOX, flipped) is flipped


def test_a_texture_decides_like_colours_on_the_vertices():
    """The vertices of a box have one colour; only its texture tells front from back."""
    box = trimesh.creation.box((0.08, 0.02, 0.12))
    # Each side of its own, with coordinates from x and z; the back takes the image's right half.
    vertices, normals = box.triangles.reshape(-1, 3), np.repeat(box.face_normals, 3, axis=0)
    u = (vertices[:, 0] / 0.08 + 0.5) / 2 + np.where(normals[:, 1] > 0.5, 0.5, 0.0)
    v = vertices[:, 2] / 0.12 + 0.5
    image = np.full((64, 128, 3), 90, np.uint8)
    image[10:30, 8:50], image[35:60, 80:120] = (220, 40, 30), (30, 60, 220)
    mesh = Mesh(
        np.array(vertices),
        np.arange(len(vertices)).reshape(-1, 3),
        np.full((len(vertices), 3), 90, np.uint8),
        normals,
        Texture(image, np.stack([u, v], axis=1)),
    )
    model = ObjectModel(
        1, "card", mesh, mesh, 0.15, np.eye(4)[None], 0.1, 0.04, np.stack(HALF_TURNS[:1])
    )
    # The front, seen from -y, drawn by hand: the image's left half.
    pose = rigid(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.array([0.0, 0.0, 0.5]))
    rgb, depth, _ = render_scene([(mesh, pose)], CAMERA, SHAPE, LIGHT)
    rows, columns = np.nonzero(depth)
    x = (columns - CAMERA[0, 2]) * depth[rows, columns] / CAMERA[0, 0]
    y = (rows - CAMERA[1, 2]) * depth[rows, columns] / CAMERA[1, 1]
    picked = ((0.5 + y / 0.12) * 63).astype(int), ((x / 0.08 + 0.5) * 63).astype(int)
    rgb[rows, columns] = image[np.clip(picked[0], 0, 63), np.clip(picked[1], 0, 63)]
    observation = observe(rgb, depth, CAMERA, VerificationSettings())
    for start in (pose, pose @ HALF_TURNS[0]):
        chosen = choose_by_texture(observation, model, start)
        np.testing.assert_allclose(chosen, pose, atol=1e-9)


def test_without_near_symmetries_or_pixels_the_pose_stays():
    pose, observation = _scene(BOX, 0)
    alone = replace(BOX, near_symmetries=np.empty((0, 4, 4)))
    assert choose_by_texture(observation, alone, pose) is pose
    for shift in ([0, 0, -2.0], [0, 0, 0.5], [5.0, 0, 0]):
        away = rigid(np.eye(3), np.array(shift, dtype=float)) @ pose
        assert choose_by_texture(observation, BOX, away) is away


def test_the_kernel_agrees_with_numpy():
    rng = np.random.default_rng(3)
    count, limit, white_balance = 200, 0.3, 0.4
    points = rng.uniform(-0.05, 0.05, (count, 3))
    observed = rng.normal(4.5, 0.5, (count, 3)).astype(np.float32)
    light, _ = np.linalg.qr(np.concatenate([np.ones((count, 1)), rng.normal(size=(count, 3))], 1))
    turns = Rotation.random(5, random_state=1).as_matrix()
    motions = rigid(turns, rng.normal(scale=0.01, size=(5, 3)))
    colors = rng.integers(0, 256, (30, 25, 20, 3)).astype(np.uint8)
    corner, cell = np.array([-0.06, -0.05, -0.04]), 0.004
    logarithms = np.log(np.arange(256, dtype=np.float32) + np.float32(20.0))
    seen = SeenSurface(observed, points, np.ascontiguousarray(light))
    grid = LogarithmGrid(colors, corner, cell, logarithms)
    found = sum_color_differences(seen, motions, grid, limit, white_balance)
    for motion, value in zip(motions, found, strict=True):
        moved = points @ motion[:3, :3].T + motion[:3, 3]
        index = np.clip(np.floor((moved - corner) / cell).astype(int), 0, [29, 24, 19])
        difference = observed - np.log(colors[tuple(index.T)] + 20.0)
        mean = difference.mean(axis=1)
        coefficients = np.linalg.lstsq(light, mean, rcond=None)[0]
        rest = mean - light @ coefficients
        deviation = difference - mean[:, None]
        balance = deviation.mean(axis=0)
        expected = np.minimum(rest**2, limit**2).mean()
        expected += np.minimum((deviation - balance) ** 2, limit**2).sum(axis=1).mean()
        expected += white_balance * (balance**2).sum()
        assert value == pytest.approx(expected, rel=1e-5)


def test_colours_agree_with_the_right_pose_and_not_with_a_grey_or_other_image():
    pose, observation = _scene(CARTON, 3)
    right = color_agreement(observation, CARTON, pose)
    assert right.correlation > 0.9 and right.contrast > 0.3
    wrong = color_agreement(observation, CARTON, pose @ HALF_TURNS[0])
    assert wrong.correlation < 0.5
    grey = np.repeat(observation.rgb.mean(axis=2, keepdims=True), 3, axis=2).astype(np.uint8)
    flat = color_agreement(replace(observation, rgb=np.full_like(grey, 90)), CARTON, pose)
    assert abs(flat.correlation) < 0.1 and flat.contrast == right.contrast


def test_without_colours_or_pixels_nothing_contradicts():
    pose, observation = _scene(CARTON, 3)
    assert color_agreement(observation, colorless(CARTON), pose) == ColorAgreement(0.0, 0.0)
    away = rigid(np.eye(3), np.array([2.0, 0.0, 0.6])) @ pose
    assert color_agreement(observation, CARTON, away) == ColorAgreement(0.0, 0.0)


def test_agreement_of_colours_is_the_correlation_without_light():
    """By its definition: least squares instead of a projection, NumPy's dot products."""
    pose, observation = _scene(CARTON, 1)
    seen = texture._seen_surface(observation, CARTON, pose)
    grid = color_grid(CARTON.mesh)
    cells = ((seen.points - grid.corner) // grid.cell).astype(int)
    drawn = np.log([20.0 + grid.colors[tuple(np.maximum(cell, 0))] for cell in cells])
    vectors = []
    for colors in (seen.colors.astype(float), drawn):
        mean = colors.mean(axis=1)
        fitted = seen.light @ np.linalg.lstsq(seen.light, mean, rcond=None)[0]
        vectors.append(np.column_stack([colors - mean[:, None], mean - fitted]).ravel())
    first, second = vectors
    expected = first @ second / np.sqrt((first @ first) * (second @ second))
    found = color_agreement(observation, CARTON, pose)
    assert found.correlation == pytest.approx(expected, abs=1e-4)
    assert found.contrast == pytest.approx(np.sqrt(second @ second / len(drawn)), rel=1e-4)
