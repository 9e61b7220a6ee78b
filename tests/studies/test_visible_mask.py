import numpy as np

from hlp.geometry import rigid
from hlp.records import Frame, Mesh, ObjectModel, Target
from hlp.studies.visible_mask import visible_mask

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


class Unmasked:
    pass


class Masked:
    def __init__(self, mask):
        self.mask = mask

    def visible_mask(self, frame, target):
        return self.mask


def test_where_no_mask_is_known_the_depth_must_agree():
    depth = np.full(SHAPE, 1.5)
    depth[5:26, 10:31] = 1.005  # the plate, 5 mm off
    depth[5:26, 10:15] = 0.7  # something before it
    depth[8:10, 20:25] = 0.0  # not measured
    expected = np.zeros(SHAPE, dtype=bool)
    expected[5:26, 15:31] = True
    expected[8:10, 20:25] = False
    seen = visible_mask(Unmasked(), frame(depth), TARGET, plate(), 0.02)
    inside = np.s_[6:25, 11:30]  # the outline itself is the renderer's business
    np.testing.assert_array_equal(seen[inside], expected[inside])
    assert not seen[~expected].any()
    assert not visible_mask(Unmasked(), frame(depth), TARGET, plate(), 0.004).any()


def test_the_data_sets_own_mask_counts_where_there_is_one():
    own = np.random.default_rng(0).random(SHAPE) < 0.3
    depth = np.full(SHAPE, 1.0)
    np.testing.assert_array_equal(
        visible_mask(Masked(own), frame(depth), TARGET, plate(), 0.02), own
    )
    assert visible_mask(Masked(None), frame(depth), TARGET, plate(), 0.02).sum() in range(380, 450)
