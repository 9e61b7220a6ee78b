"""What must hold of pose errors for every pose, object and group of symmetries."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from generated_values import cameras, motions, point_sets, poses_in_front
from hlp.evaluation.errors import add, add_s, mspd, mssd, nearest_symmetric_pose, rotation_error
from hlp.geometry import inverse, rigid, rotation_distance, transform

ALONE = np.eye(4)[None]


@st.composite
def symmetric_objects(draw):
    """Vertices and the cyclic group of 2 to 6 motions, about any axis, that maps them to them."""
    place = draw(motions(0.02))
    order = draw(st.integers(2, 6))
    turns = [Rotation.from_rotvec([0, 0, 2 * np.pi * i / order]).as_matrix() for i in range(order)]
    group = np.stack([place @ rigid(turn, np.zeros(3)) @ inverse(place) for turn in turns])
    part = draw(point_sets(1, 12))
    return np.concatenate([transform(each, part) for each in group]), group


@given(poses_in_front(), poses_in_front(), motions(), point_sets())
def test_errors_in_metres_do_not_depend_on_where_the_camera_is(estimated, true, camera, points):
    for error in (add, add_s, lambda a, b, v: mssd(a, b, v, ALONE)):
        here = error(estimated, true, points)
        np.testing.assert_allclose(
            error(camera @ estimated, camera @ true, points), here, atol=1e-9
        )
        assert error(true, true, points) < 1e-9


@given(poses_in_front(), poses_in_front(), point_sets())
def test_add_is_symmetric_and_between_adi_and_the_largest_distance(estimated, true, points):
    distance = add(estimated, true, points)
    np.testing.assert_allclose(add(true, estimated, points), distance, atol=1e-12)
    assert add_s(estimated, true, points) <= distance + 1e-12
    assert distance <= mssd(estimated, true, points, ALONE) + 1e-12


@given(poses_in_front(), poses_in_front(), symmetric_objects(), cameras(), st.data())
def test_symmetric_siblings_of_a_pose_have_equal_errors(estimated, true, thing, camera, data):
    vertices, group = thing
    sibling = group[data.draw(st.integers(0, len(group) - 1))]
    in_metres, in_pixels = mssd(estimated, true, vertices, group), None
    both = np.concatenate([transform(each, vertices) for each in (estimated, true)])
    if both[:, 2].min() > 0.01:
        in_pixels = mspd(estimated, true, vertices, group, camera)
    for first, second in ((estimated @ sibling, true), (estimated, true @ sibling)):
        np.testing.assert_allclose(mssd(first, second, vertices, group), in_metres, atol=1e-9)
        np.testing.assert_allclose(
            add_s(first, second, vertices), add_s(estimated, true, vertices), atol=1e-9
        )
        if in_pixels is not None:
            same = mspd(first, second, vertices, group, camera)
            np.testing.assert_allclose(same, in_pixels, rtol=1e-7, atol=1e-7)
    assert in_metres <= mssd(estimated, true, vertices, ALONE) + 1e-12
    assert add_s(true @ sibling, true, vertices) < 1e-9
    assert mssd(true @ sibling, true, vertices, group) < 1e-9


@given(poses_in_front(), poses_in_front(), symmetric_objects())
def test_the_nearest_symmetric_pose_is_a_sibling_and_none_is_nearer(estimated, true, thing):
    _, group = thing
    nearest = nearest_symmetric_pose(estimated, true, group)
    siblings = true @ group
    assert np.abs(siblings - nearest).max(axis=(1, 2)).min() < 1e-12
    distances = rotation_distance(estimated[None, :3, :3], siblings[:, :3, :3])
    assert rotation_error(estimated, nearest) <= distances.min() + 1e-12
