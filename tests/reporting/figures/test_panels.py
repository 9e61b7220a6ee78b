"""What is drawn over a frame, and pictures as files."""

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from box_scene import SHAPE, at
from hlp.records import Frame, ObjectModel, Votes
from hlp.reporting.figures.panels import (
    ESTIMATE_COLOR,
    TRUTH_COLOR,
    draw_detections,
    draw_poses,
    draw_region,
    weight_by_cell,
    write_picture,
)

CAMERA = np.array([[100.0, 0.0, 49.5], [0.0, 100.0, 35.0], [0.0, 0.0, 1.0]])
SMALL = (70, 101)  # neither side is a whole number of cells


def votes_at(centroids: np.ndarray) -> Votes:
    number = len(centroids)
    rotations = np.repeat(np.eye(3)[None], number, axis=0)
    pixels = np.zeros((number, 2))
    return Votes(centroids, rotations, np.ones(number), np.arange(number), pixels)


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
    np.testing.assert_allclose(weight_by_cell(votes, CAMERA, SMALL), expected)
    assert weight_by_cell(votes_at(np.zeros((0, 3))), CAMERA, SMALL).sum() == 0


def test_region_keeps_its_brightness_and_the_rest_is_darkened() -> None:
    rgb = np.full((*SMALL, 3), 120, dtype=np.uint8)
    mask = np.zeros(SMALL, dtype=bool)
    mask[10:40, 20:60] = True
    picture = draw_region(rgb, mask)
    assert (picture[15:35, 25:55] == 120).all()
    assert (picture[45:, 65:] == 40).all()


def has(picture: np.ndarray, color: tuple[int, int, int]) -> bool:
    return bool((np.abs(picture.astype(int) - color).sum(axis=2) < 12).any())


def test_poses_are_drawn_where_they_are(shot: Frame, box: ObjectModel) -> None:
    half = SHAPE[1] // 2
    picture = draw_poses(shot, box, at(-0.25, 0.0, 1.0), at(0.25, 0.0, 1.0))
    for side, drawn, absent in (
        (picture[:, :half], ESTIMATE_COLOR, TRUTH_COLOR),
        (picture[:, half:], TRUTH_COLOR, ESTIMATE_COLOR),
    ):
        assert has(side, drawn) and not has(side, absent)
    np.testing.assert_allclose(picture[:5, :5], 0.8 * shot.rgb[:5, :5], atol=1)


def test_the_nearer_of_two_objects_hides_the_other(shot: Frame, box: ObjectModel) -> None:
    poses = [at(0.0, 0.0, 0.8), at(0.02, 0.0, 1.5)]
    both = draw_detections(shot, [(box, pose) for pose in poses])
    np.testing.assert_array_equal(both, draw_detections(shot, [(box, p) for p in poses[::-1]]))
    alone = draw_detections(shot, [(box, poses[0])])
    middle = (slice(110, 115), slice(150, 155))
    assert not (both[middle] == draw_detections(shot, [(box, poses[1])])[middle]).all()
    assert np.abs(both[middle].astype(int) - alone[middle]).max() < 60


def test_a_small_file_keeps_what_is_seen(tmp_path: Path) -> None:
    picture = np.full((40, 60, 3), 90, dtype=np.uint8)
    picture[10:30, 20:50] = TRUTH_COLOR
    write_picture(tmp_path / "picture.jpg", picture)
    read = cv2.cvtColor(cv2.imread(str(tmp_path / "picture.jpg")), cv2.COLOR_BGR2RGB)
    assert np.abs(read.astype(int) - picture).mean() < 6
    (tmp_path / "panels.jpg").mkdir()
    with pytest.raises(OSError, match=r"panels\.jpg"):
        write_picture(tmp_path / "panels.jpg", np.zeros((2, 2, 3), dtype=np.uint8))
