"""BOP's recalls against references written without HLP's renderer, errors and matching."""

import numpy as np
import pytest
import trimesh
from boxes import EXTENTS, TRUE, K, box_model, moved
from ray_boxes import box_depth
from scipy.spatial.transform import Rotation

from hlp.evaluation.bop_recalls import FRACTIONS, BopRecalls, measured_mask, unoccluded_mask
from hlp.evaluation.errors import VSD_DELTA, vsd
from hlp.geometry import rigid
from hlp.records import Frame, Target
from refinement_scene import model_of

DIAMETER = float(np.linalg.norm(EXTENTS))
SHAPE = (120, 160)
QUARTER = rigid(Rotation.from_euler("z", 90, degrees=True).as_matrix(), np.zeros(3))


MODEL = box_model(EXTENTS, fine=False)
RECALLS = BopRecalls(MODEL, MODEL.mesh)


def _box_depth(pose, offset):
    return box_depth(pose, EXTENTS, K, SHAPE, offset)


def _reference_vsd(estimated, true, observed, offset=0.5):
    """That of whole images, drawn as the toolkit does: rays through pixel centres at + 0.5.

    test_toolkit_values.py compares what follows from the images with the toolkit's own values.
    """
    drawn = (_box_depth(pose, offset) for pose in (estimated, true))
    return vsd(*drawn, observed, K, FRACTIONS * DIAMETER)


def _scene(occluder=False, holes=False):
    depth = np.where(_box_depth(TRUE, 0.0) > 0, _box_depth(TRUE, 0.0), 1.2)
    if occluder:
        depth[:, :78] = 0.6
    if holes:
        depth[55:70, 90:110] = 0.0
    return depth


@pytest.mark.parametrize(
    ("estimated", "scene"),
    [
        (TRUE, {}),
        (moved(dx=0.004, degrees=3.0), {}),
        (moved(dx=0.01, dz=0.02), {"occluder": True}),
        (moved(dz=-0.03, degrees=10.0), {"occluder": True, "holes": True}),
        (moved(dx=0.11), {}),  # partly outside the image
        (moved(dx=-0.05, dy=0.06), {"holes": True}),
    ],
)
def test_vsd_is_the_toolkits_on_an_independent_rendering(estimated, scene):
    observed = _scene(**scene)
    found = RECALLS._vsd(estimated, TRUE, K, observed)
    expected = _reference_vsd(estimated, TRUE, observed)
    # A pixel at an edge may fall on either side by rounding.
    np.testing.assert_allclose(
        found, expected, atol=1.01 / max((_box_depth(TRUE, 0.5) > 0).sum(), 1)
    )
    if not np.array_equal(estimated, TRUE):
        without = _reference_vsd(estimated, TRUE, observed, offset=0.0)
        assert np.abs(found - expected).mean() < np.abs(found - without).mean() + 1e-12


@pytest.mark.parametrize(
    "estimated", [moved(dx=0.3), moved(dx=5.0), moved(dz=-2.0), moved(dz=-0.8)]
)
def test_vsd_of_a_pose_that_misses_the_object_is_that_of_the_whole_image(estimated):
    found = RECALLS._vsd(estimated, TRUE, K, _scene())
    if estimated[2, 3] > 0.2:  # others are not drawn: they cross the camera
        np.testing.assert_allclose(found, _reference_vsd(estimated, TRUE, _scene()))
    np.testing.assert_array_equal(found, 1.0)


def test_without_estimates_nothing_is_matched():
    recalls = RECALLS.of([TRUE, moved(dx=0.1)], [], K, 160, _scene())
    np.testing.assert_array_equal(recalls, np.zeros((2, 3)))


def test_recalls_of_several_instances_count_matches_below_each_threshold():
    """A wrong estimate of the highest score takes no instance from a right one."""
    left, right = moved(dx=-0.06), moved(dx=0.06)
    wrong, near = moved(dx=-0.06, dz=0.09), moved(dx=-0.06, dz=0.01)
    by_surface, mssd, mspd = RECALLS.of([left, right], [wrong, near], K, 160, _scene()).T
    distance = 0.01 / DIAMETER
    assert mssd[0] == pytest.approx((distance < FRACTIONS).mean())
    # Where both lie below a threshold, the first takes the instance and the second has none left.
    assert mssd[1] == 0.0 and by_surface[1] == 0.0
    assert 0 < mspd[0] <= 1 and 0 < by_surface[0] <= 1


CAMERA = np.array([[100.0, 0.0, 20.0], [0.0, 100.0, 15.0], [0.0, 0.0, 1.0]])
PLATE_SHAPE = (30, 40)


def plate():
    """A flat square of 20 cm, seen face on from 1 m: 20 px wide about the image's centre."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.1
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return model_of(trimesh.Trimesh(corners, faces, process=False))


TARGET = Target(1, rigid(np.eye(3), np.array([0.0, 0.0, 1.0])))


def frame(depth):
    rgb = np.zeros((*PLATE_SHAPE, 3), np.uint8)
    return Frame(0, 0, rgb, depth.astype(np.float32), CAMERA, (TARGET,))


def observed(plate_depth):
    """A wall at 1.5 m, the plate, something in front of its left side, and a hole in the depth."""
    depth = np.full(PLATE_SHAPE, 1.5)
    depth[5:26, 10:31] = plate_depth
    depth[5:26, 10:15] = 0.7
    depth[8:10, 20:25] = 0.0
    return frame(depth)


INSIDE = np.s_[6:25, 11:30]  # the outline itself depends on the renderer
HOLE = np.s_[8:10, 20:25]


def test_measured_where_the_depth_agrees():
    expected = np.zeros(PLATE_SHAPE, dtype=bool)
    expected[5:26, 15:31] = True
    expected[HOLE] = False
    seen = measured_mask(observed(1.005), TARGET, plate(), 0.02)
    np.testing.assert_array_equal(seen[INSIDE], expected[INSIDE])
    assert not seen[~expected].any()
    assert not measured_mask(observed(1.005), TARGET, plate(), 0.004).any()


def test_unoccluded_wherever_nothing_is_in_front():
    """Pixels without depth count, and those that show something far behind the target."""
    expected = np.zeros(PLATE_SHAPE, dtype=bool)
    expected[5:26, 15:31] = True
    for plate_depth in (1.0, 1.3, 1.0 - 0.9 * VSD_DELTA):
        seen = unoccluded_mask(observed(plate_depth), TARGET, plate())
        np.testing.assert_array_equal(seen[INSIDE], expected[INSIDE])
        assert not seen[~expected].any()
    seen = unoccluded_mask(observed(1.0 - 1.1 * VSD_DELTA), TARGET, plate())
    assert set(zip(*np.nonzero(seen), strict=True)) == {
        (y, x) for y in range(8, 10) for x in range(20, 25)
    }
