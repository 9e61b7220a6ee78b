import numpy as np
import pytest

from box_scene import CAMERA, SHAPE, at
from hlp.geometry import project
from hlp.records import Frame, ObjectModel
from hlp.rendering.rasterizer import render_depth
from hlp.reporting.figures.tiles import LIMIT_MM, color_differences, draw_outlines, enlarge


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


def test_differences_are_blue_before_and_red_behind_and_white_between() -> None:
    observed = np.array([[1.0, 1.0, 1.0, 0.0, 1.0]])
    shift = LIMIT_MM / 1000
    rendered = np.array([[1.0 - shift, 1.0, 1.0 + 3 * shift, 1.0, 0.0]])
    colors = color_differences(rendered, observed)[0].astype(int)
    assert colors[0, 2] > colors[0, 0] + 60
    assert (colors[1] > 240).all()
    assert colors[2, 0] > colors[2, 2] + 60
    np.testing.assert_array_equal(colors[3], colors[4])
    assert colors[3].max() < 60


@pytest.mark.parametrize("color", [(255, 0, 0), (0, 0, 255)])
def test_outlines_have_the_colour_that_is_given(
    shot: Frame, box: ObjectModel, color: tuple[int, int, int]
) -> None:
    picture = draw_outlines(shot, box, [(at(0.05, 0.0, 0.8), color)])
    drawn = (picture == color).all(axis=2)
    assert 100 < drawn.sum() < 400
    assert (picture[~drawn] == shot.rgb[~drawn]).all()
