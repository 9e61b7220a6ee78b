"""What is drawn over a frame, and pictures as files."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from box_scene import CAMERA, SHAPE, at
from hlp.geometry import project
from hlp.records import Frame, ObjectModel, PoseEstimate, Region, Target, TargetScore, Votes
from hlp.rendering.rasterizer import render_depth
from hlp.reporting.figures import LEGEND_HEIGHT, TITLE_HEIGHT
from hlp.reporting.figures.panels import (
    ESTIMATE_COLOR,
    RIGHT_COLOR,
    TRUTH_COLOR,
    WRONG_COLOR,
    SeenTarget,
    describe_target,
    draw_detections,
    draw_overview,
    draw_panels,
    draw_region,
    enlarge,
    weight_by_cell,
    write_picture,
)

SMALL_CAMERA = np.array([[100.0, 0.0, 49.5], [0.0, 100.0, 35.0], [0.0, 0.0, 1.0]])
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
    votes = replace(votes_at(centroids), weights=weights)
    assert expected.sum() > 300
    np.testing.assert_allclose(weight_by_cell(votes, SMALL_CAMERA, SMALL), expected)
    assert weight_by_cell(votes_at(np.zeros((0, 3))), SMALL_CAMERA, SMALL).sum() == 0


def test_region_keeps_its_brightness_and_the_rest_is_darkened() -> None:
    rgb = np.full((*SMALL, 3), 120, dtype=np.uint8)
    mask = np.zeros(SMALL, dtype=bool)
    mask[10:40, 20:60] = True
    picture = draw_region(rgb, mask)
    assert (picture[15:35, 25:55] == 120).all()
    assert (picture[45:, 65:] == 40).all()


def test_a_pose_is_drawn_where_it_is_on_the_grey_picture(shot: Frame, box: ObjectModel) -> None:
    picture = draw_detections(shot, [(box, at(-0.25, 0.0, 1.0))])
    near = np.abs(picture.astype(int) - ESTIMATE_COLOR).sum(axis=2) < 12
    assert near[:, : SHAPE[1] // 2].any() and not near[:, SHAPE[1] // 2 :].any()
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


@pytest.fixture
def seen(shot: Frame, box: ObjectModel) -> SeenTarget:
    votes = Votes(
        np.array([[0.05, 0.0, 0.8], [0.05, 0.0, 0.8], [-0.2, 0.1, 0.9]]),
        np.repeat(np.eye(3)[None], 3, axis=0),
        np.array([1.0, 2.0, 0.5]),
        np.arange(3),
        np.array([[170.0, 120.0], [180.0, 110.0], [100.0, 150.0]]),
    )
    region = Region(1, np.zeros((3, 2)), np.ones(3), np.ones(SHAPE, dtype=bool))
    estimate = PoseEstimate(1, 2, 1, at(0.05, 0.003, 0.8), 0.93)
    score = TargetScore(1, 2, 1, True, 0.87, 0.0031, 0.02, 0.003, 0.9, True, True, True, score=0.93)
    truth = Target(1, at(0.05, 0.0, 0.8), 0.87)
    return SeenTarget(shot, box, region, votes, at(0.06, 0.01, 0.82), estimate, truth, score)


def count(picture: np.ndarray, color: tuple[int, int, int]) -> int:
    return int((np.abs(picture.astype(int) - color).sum(axis=2) < 12).sum())


def test_four_panels_show_answer_and_truth(seen: SeenTarget) -> None:
    picture = draw_panels(seen)
    height, width = SHAPE
    assert picture.shape[1] == 2 * width
    assert picture.shape[0] == 2 * (height + TITLE_HEIGHT + LEGEND_HEIGHT) + 36
    none = np.zeros((0, 3))
    empty = Votes(none, np.zeros((0, 3, 3)), np.zeros(0), np.zeros(0, int), np.zeros((0, 2)))
    without = draw_panels(replace(seen, votes=empty, coarse=None, estimate=None))
    assert without.shape == picture.shape
    for whole, colors in ((picture, (ESTIMATE_COLOR, TRUTH_COLOR)), (without, (TRUTH_COLOR,))):
        poses = whole[-height - LEGEND_HEIGHT : -LEGEND_HEIGHT, width:]
        shown = [color for color in (ESTIMATE_COLOR, TRUTH_COLOR) if count(poses, color) > 30]
        assert tuple(shown) == colors


def test_the_line_tells_verdict_errors_and_score(seen: SeenTarget) -> None:
    assert describe_target(seen) == (
        "000001_000002  box: right; ADD(-S) 3.1 mm (a tenth of the diameter: 17.2), 1.1 deg, "
        "3.0 mm; score 0.93; visible 0.87"
    )
    wrong = replace(seen.score, add_correct=False, cause="no_votes")
    assert "box: wrong, no votes; ADD(-S)" in describe_target(replace(seen, score=wrong))
    missed = replace(wrong, found=False, visible_fraction=float("nan"))
    assert describe_target(replace(seen, score=missed)).endswith("box: not found, no votes")


def test_what_is_enlarged_fits_its_camera(shot: Frame, box: ObjectModel) -> None:
    pose = at(0.05, 0.0, 0.8)
    near = enlarge(shot, box, [pose])
    assert near.rgb.shape == shot.rgb.shape
    scale = near.camera_matrix[0, 0] / CAMERA[0, 0]
    assert 2.0 < scale < 6.0
    (center,) = project(pose[None, :3, 3], near.camera_matrix)
    np.testing.assert_allclose(center, (159.5, 119.5), atol=12)  # the nearer face is larger
    rendered = render_depth(box.mesh, pose[None], near.camera_matrix, SHAPE)[0]
    observed = (near.depth > 0) & (near.depth < 1.0)
    both, either = (rendered > 0) & observed, (rendered > 0) | observed
    assert both.sum() / either.sum() > 0.97
    assert np.median(np.abs(rendered - near.depth)[both]) < 1e-6


def test_what_cannot_be_seen_is_not_enlarged(shot: Frame, box: ObjectModel) -> None:
    assert enlarge(shot, box, []) is shot
    assert enlarge(shot, box, [at(0, 0, -1.0)]) is shot


def test_right_and_wrong_poses_are_outlined_in_their_colours(seen: SeenTarget) -> None:
    assert seen.estimate is not None
    targets = [
        replace(
            seen,
            estimate=replace(seen.estimate, pose_cam_obj=at(x, 0.0, 0.8)),
            score=replace(seen.score, add_correct=right),
        )
        for x, right in ((-0.2, False), (0.2, True))
    ]
    lost = replace(seen, estimate=None, score=replace(seen.score, add_correct=False))
    picture = draw_overview(seen.frame, [*targets, lost])
    assert picture.shape[1] == SHAPE[1]
    frame = picture[-SHAPE[0] - 20 : -20]
    left, right = frame[:, :160], frame[:, 160:]
    assert count(left, WRONG_COLOR) > 30 and count(left, RIGHT_COLOR) == 0
    assert count(right, RIGHT_COLOR) > 30 and count(right, WRONG_COLOR) == 0
