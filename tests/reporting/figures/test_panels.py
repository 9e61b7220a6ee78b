import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from hlp.records import Frame, Mesh, ObjectModel, Votes
from hlp.reporting.figures.panels import (
    ESTIMATE_COLOR,
    TRUTH_COLOR,
    draw_poses,
    draw_region,
    weight_by_cell,
    write_picture,
)

CAMERA = np.array([[100.0, 0.0, 49.5], [0.0, 100.0, 35.0], [0.0, 0.0, 1.0]])
SHAPE = (70, 101)  # neither side is a whole number of cells


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    box = trimesh.creation.box((0.2, 0.2, 0.2))
    mesh = Mesh(
        np.asarray(box.vertices),
        np.asarray(box.faces),
        np.full((8, 3), 200, dtype=np.uint8),
        np.asarray(box.vertex_normals),
    )
    return ObjectModel(1, "box", mesh, mesh, 0.2 * 3**0.5, np.eye(4)[None], 0.2, 0.1)


def frame(rng: np.random.Generator) -> Frame:
    rgb = rng.integers(90, 110, (*SHAPE, 3), dtype=np.uint8)
    return Frame(1, 2, rgb, np.ones(SHAPE, dtype=np.float32), CAMERA)


def at(x: float, y: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def votes_at(centroids: np.ndarray) -> Votes:
    number = len(centroids)
    rotations = np.repeat(np.eye(3)[None], number, axis=0)
    pixels = np.zeros((number, 2))
    return Votes(centroids, rotations, np.ones(number), np.arange(number), pixels)


def has(picture: np.ndarray, color: tuple[int, int, int]) -> bool:
    return bool((np.abs(picture.astype(int) - color).sum(axis=2) < 12).any())


def test_weights_are_summed_in_the_cell_of_the_pixel_they_fall_on() -> None:
    rng = np.random.default_rng(0)
    centroids = rng.uniform((-0.8, -0.6, -0.2), (0.8, 0.6, 1.5), (2000, 3))
    weights = rng.uniform(0.1, 2.0, len(centroids))
    expected = np.zeros((9, 13))
    for (x, y, z), weight in zip(centroids, weights, strict=True):
        if z <= 0:
            continue
        column, row = round(100 * x / z + 49.5), round(100 * y / z + 35.0)
        if 0 <= column < 104 and 0 <= row < 72:
            expected[row // 8, column // 8] += weight
    votes = dataclasses.replace(votes_at(centroids), weights=weights)
    assert expected.sum() > 300
    np.testing.assert_allclose(weight_by_cell(votes, CAMERA, SHAPE), expected)


def test_no_votes_weigh_nothing() -> None:
    assert weight_by_cell(votes_at(np.zeros((0, 3))), CAMERA, SHAPE).sum() == 0


def test_region_keeps_its_brightness_and_the_rest_is_darkened() -> None:
    rgb = np.full((*SHAPE, 3), 120, dtype=np.uint8)
    mask = np.zeros(SHAPE, dtype=bool)
    mask[10:40, 20:60] = True
    picture = draw_region(rgb, mask)
    assert (picture[15:35, 25:55] == 120).all()
    assert (picture[45:, 65:] == 40).all()


def test_poses_are_drawn_where_they_are(model: ObjectModel) -> None:
    shot = frame(np.random.default_rng(0))
    estimate, truth = at(-0.25, 0.0, 1.0), at(0.25, 0.0, 1.0)
    picture = draw_poses(shot, model, estimate, truth)
    assert has(picture[:, :50], ESTIMATE_COLOR)
    assert has(picture[:, 51:], TRUTH_COLOR)
    assert not has(picture[:, :50], TRUTH_COLOR)
    assert not has(picture[:, 51:], ESTIMATE_COLOR)
    corner = np.repeat(cv2.cvtColor(shot.rgb, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)[:5, :5]
    np.testing.assert_allclose(picture[:5, :5], 0.8 * corner, atol=1)


def test_a_small_file_keeps_what_is_seen(tmp_path: Path) -> None:
    picture = np.full((40, 60, 3), 90, dtype=np.uint8)
    picture[10:30, 20:50] = TRUTH_COLOR
    write_picture(tmp_path / "picture.jpg", picture)
    read = cv2.cvtColor(cv2.imread(str(tmp_path / "picture.jpg")), cv2.COLOR_BGR2RGB)
    assert np.abs(read.astype(int) - picture).mean() < 6


def test_unwritable_picture_is_named(tmp_path: Path) -> None:
    (tmp_path / "panels.jpg").mkdir()
    with pytest.raises(OSError, match=r"panels\.jpg"):
        write_picture(tmp_path / "panels.jpg", np.zeros((2, 2, 3), dtype=np.uint8))
