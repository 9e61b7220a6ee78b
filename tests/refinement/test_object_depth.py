"""An object's depth in its part of an image, against that of the whole image."""

import numpy as np
import pytest
import trimesh

from hlp.geometry import rigid
from hlp.refinement.object_depth import BORDER, ObjectDepth
from hlp.rendering.rasterizer import render_depth
from refinement_scene import CAMERA, SHAPE, as_mesh

MESH = as_mesh(trimesh.creation.box((0.06, 0.1, 0.04)))
TILTED = trimesh.transformations.rotation_matrix(0.4, [1, 2, 0])[:3, :3]


def pose(x, y, z=0.6):
    return rigid(TILTED, np.array([x, y, z]))


def whole(of):
    """The whole image with a part in its place."""
    image = np.zeros(SHAPE, np.float32)
    image[of.rows, of.columns] = of.depth
    return image


@pytest.mark.parametrize(
    "place", [(0.0, 0.0), (0.17, 0.0), (-0.18, -0.13), (0.9, 0.0), (0.0, 0.0, 0.06), (0, 0, -1.0)]
)
def test_the_part_holds_the_depth_of_the_whole_image_and_some_pixels_around(place):
    """Also cut off by the border, outside of the image, too near, and behind the camera."""
    drawn = ObjectDepth.of(MESH, pose(*place), CAMERA, SHAPE)
    expected = render_depth(MESH, pose(*place)[None], CAMERA, SHAPE)[0]
    np.testing.assert_allclose(whole(drawn), expected, rtol=1e-6)
    y, x = np.nonzero(expected)
    for span, seen, size in ((drawn.rows, y, SHAPE[0]), (drawn.columns, x, SHAPE[1])):
        assert 0 <= span.start < span.stop <= size
        if len(seen):
            assert span.start <= max(seen.min() - BORDER, 0)
            assert span.stop >= min(seen.max() + 1 + BORDER, size)


def test_pixels_are_explained_up_to_the_tolerance():
    drawn = ObjectDepth.of(MESH, pose(0.0, 0.0), CAMERA, SHAPE)
    depth = np.full(SHAPE, 0.8, np.float32)
    drawn.part(depth)[:] = np.where(drawn.depth > 0, drawn.depth + np.float32(0.01), 0.8)
    assert not drawn.explains(depth, 0.009).any()
    np.testing.assert_array_equal(drawn.explains(depth, 0.011), drawn.depth > 0)


def test_what_others_hide_is_where_they_are_in_front_and_nearer_to_what_was_seen():
    places = [(0.0, 0.0, 0.6), (0.05, 0.02, 0.59), (-0.05, 0.0, 0.62), (0.0, -0.08, 0.6)]
    own, *others = (ObjectDepth.of(MESH, pose(*place), CAMERA, SHAPE) for place in places)
    images = np.stack([whole(each) for each in (own, *others)])
    depth = np.where(images > 0, images, np.inf).min(axis=0)
    depth = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    depth[:110] = 0.0  # no depth there
    depth[130:] += np.float32(0.2)  # nor what others explain better
    expected = np.zeros(SHAPE, bool)
    for front in images[1:]:
        drawn = (images[0] > 0) & (front > 0) & (front < images[0] - 0.002) & (depth > 0)
        expected |= drawn & (np.abs(depth - front) < np.abs(depth - images[0]))
    assert 100 < np.count_nonzero(expected) < 0.8 * np.count_nonzero(own.depth)
    np.testing.assert_array_equal(own.hidden_by(others, depth), own.part(expected))
    assert not own.hidden_by([], depth).any()
    far = ObjectDepth.of(MESH, pose(0.17, 0.1), CAMERA, SHAPE)
    assert not own.hidden_by([far], depth).any()
