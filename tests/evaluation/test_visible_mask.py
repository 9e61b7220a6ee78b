import numpy as np

from hlp.evaluation.bop_recalls import measured_mask, unoccluded_mask
from hlp.evaluation.errors import VSD_DELTA
from hlp.geometry import rigid
from hlp.records import Frame, Mesh, ObjectModel, Target

CAMERA = np.array([[100.0, 0.0, 20.0], [0.0, 100.0, 15.0], [0.0, 0.0, 1.0]])
SHAPE = (30, 40)


def plate():
    """A flat square of 20 cm, seen face on from 1 m: 20 px wide about the image's centre."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.1
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    normals = np.tile([0.0, 0.0, -1.0], (4, 1))
    mesh = Mesh(corners, faces, np.full((4, 3), 99, np.uint8), normals)
    return ObjectModel(1, "plate", mesh, mesh, 0.28, np.eye(4)[None], 0.1, 0.04)


TARGET = Target(1, rigid(np.eye(3), np.array([0.0, 0.0, 1.0])))


def frame(depth):
    rgb = np.zeros((*SHAPE, 3), np.uint8)
    return Frame(0, 0, rgb, depth.astype(np.float32), CAMERA, (TARGET,))


def observed(plate_depth):
    """A wall at 1.5 m, the plate, something in front of its left side, and a hole in the depth."""
    depth = np.full(SHAPE, 1.5)
    depth[5:26, 10:31] = plate_depth
    depth[5:26, 10:15] = 0.7
    depth[8:10, 20:25] = 0.0
    return frame(depth)


INSIDE = np.s_[6:25, 11:30]  # the outline itself depends on the renderer
HOLE = np.s_[8:10, 20:25]


def test_measured_where_the_depth_agrees():
    expected = np.zeros(SHAPE, dtype=bool)
    expected[5:26, 15:31] = True
    expected[HOLE] = False
    seen = measured_mask(observed(1.005), TARGET, plate(), 0.02)
    np.testing.assert_array_equal(seen[INSIDE], expected[INSIDE])
    assert not seen[~expected].any()
    assert not measured_mask(observed(1.005), TARGET, plate(), 0.004).any()


def test_unoccluded_wherever_nothing_is_in_front():
    """Pixels without depth count, and those that show something far behind the target."""
    expected = np.zeros(SHAPE, dtype=bool)
    expected[5:26, 15:31] = True
    for plate_depth in (1.0, 1.3, 1.0 - 0.9 * VSD_DELTA):
        seen = unoccluded_mask(observed(plate_depth), TARGET, plate())
        np.testing.assert_array_equal(seen[INSIDE], expected[INSIDE])
        assert not seen[~expected].any()
    seen = unoccluded_mask(observed(1.0 - 1.1 * VSD_DELTA), TARGET, plate())
    assert set(zip(*np.nonzero(seen), strict=True)) == {
        (y, x) for y in range(8, 10) for x in range(20, 25)
    }
