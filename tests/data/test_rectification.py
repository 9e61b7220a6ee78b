from pathlib import Path

import cv2
import numpy as np
import pytest

from hlp.data.camera_files import Camera
from hlp.data.rectification import check_size, resampled_depth, resized_camera, undistorted

MATRIX = np.array([[60.0, 0, 31.5], [0, 62.0, 23.5], [0, 0, 1]])
PLAIN = Camera(MATRIX)
BENT = Camera(MATRIX, distortion=(-0.3, 0.1, 0.001, -0.002, 0.0))


def test_without_distortion_the_image_is_the_same():
    image = np.zeros((48, 64, 3), np.uint8)
    assert undistorted(image, PLAIN, nearest=False) is image


def test_a_bent_point_goes_back_to_where_a_straight_camera_sees_it():
    """The bent position of a ray is computed by OpenCV's projection, from the ray itself."""
    ray = np.array([[0.45, 0.3, 1.0]])
    seen, _ = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), MATRIX, np.array(BENT.distortion))
    straight = (MATRIX @ ray[0])[:2]
    across, down = np.meshgrid(np.arange(64), np.arange(48))
    away = np.hypot(across - seen[0, 0, 0], down - seen[0, 0, 1])
    assert np.linalg.norm(seen[0, 0] - straight) > 2.0
    for nearest in (False, True):
        image = np.exp(-((away / 2.0) ** 2)).astype(np.float32)
        found = undistorted(image, BENT, nearest)
        y, x = np.unravel_index(found.argmax(), found.shape)
        assert np.linalg.norm([x, y] - straight) < 1.0


def test_depth_is_never_mixed_across_an_edge():
    depth = np.full((48, 64), 1.0, np.float32)
    depth[:, 30:] = 3.0
    assert set(np.unique(undistorted(depth, BENT, nearest=True))) <= {0.0, 1.0, 3.0}
    assert len(np.unique(undistorted(depth, BENT, nearest=False))) > 3


def test_a_fisheye_is_undone_by_its_own_model():
    camera = Camera(MATRIX, distortion=(0.2, 0.0, 0.0, 0.0), fisheye=True)
    ray = np.array([0.4, 0.0, 1.0])
    angle = np.arctan(0.4)
    bent = angle * (1 + 0.2 * angle**2) * MATRIX[0, 0] + MATRIX[0, 2]
    image = np.zeros((48, 64), np.float32)
    image[:, int(np.rint(bent)) - 1 : int(np.rint(bent)) + 2] = 1.0
    found = undistorted(image, camera, nearest=True)
    assert found[24, int(np.rint((MATRIX @ ray)[0]))] == 1.0


def test_depth_of_another_camera_lands_on_the_rays_of_the_colour_pixels():
    """A slanted plane seen by both cameras from one place has one depth on each ray."""
    other = Camera(np.array([[45.0, 0, 20.0], [0, 44.0, 18.0], [0, 0, 1]]))

    def plane(matrix, shape):
        _, x = np.mgrid[: shape[0], : shape[1]]
        ray = (x - matrix[0, 2]) / matrix[0, 0]
        return (1.0 / (1.0 + 0.2 * ray)).astype(np.float32)

    found = resampled_depth(plane(other.matrix, (36, 40)), other, MATRIX, (48, 64))
    expected = plane(MATRIX, (48, 64))
    seen = found > 0
    np.testing.assert_allclose(found[seen], expected[seen], atol=0.01)
    across = (np.arange(64) - MATRIX[0, 2]) / MATRIX[0, 0] * 45 + 20
    np.testing.assert_array_equal(seen[24], (np.rint(across) >= 0) & (np.rint(across) < 40))


@pytest.mark.parametrize("factor", [2, 3])
def test_an_image_made_smaller_is_made_larger_again_pixel_by_pixel(factor):
    depth = np.random.default_rng(0).random((48 // factor, 63 // factor)).astype(np.float32)
    camera = resized_camera(MATRIX, 1 / factor, depth.shape[::-1])
    shape = (depth.shape[0] * factor, depth.shape[1] * factor)
    found = resampled_depth(depth, camera, MATRIX, shape)
    expected = np.repeat(np.repeat(depth, factor, 0), factor, 1)
    np.testing.assert_array_equal(found, expected)


def test_intrinsics_of_other_images_are_refused():
    check_size(Camera(MATRIX, (64, 48)), (48, 64, 3), Path("a.png"), "intrinsics")
    with pytest.raises(ValueError, match=r"128x96, but a\.png is 64x48: .*multiply .* by 0\.5"):
        check_size(Camera(MATRIX, (128, 96)), (48, 64, 3), Path("a.png"), "intrinsics")
    with pytest.raises(ValueError, match=r"intrinsics are those of images of 128x64.*stream"):
        check_size(Camera(MATRIX, (128, 64)), (48, 64, 3), Path("a.png"), "intrinsics")
    with pytest.raises(ValueError, match=r"principal point \(31\.5, 23\.5\) lies outside"):
        check_size(PLAIN, (20, 30), Path("a.png"), "intrinsics")
