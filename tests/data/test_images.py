import cv2
import numpy as np
import pytest
from PIL import Image

from hlp.data import images


def _rgb(height=40, width=60):
    y, x = np.mgrid[0:height, 0:width]
    return np.stack([x * 4, y * 6, np.full_like(x, 30)], axis=-1).astype(np.uint8)


def test_colours_come_as_rgb(tmp_path):
    Image.fromarray(_rgb()).save(tmp_path / "a.png")
    np.testing.assert_array_equal(images.read_rgb(tmp_path / "a.png"), _rgb())


def test_grey_pictures_get_three_channels(tmp_path):
    Image.fromarray(_rgb()[..., 0]).save(tmp_path / "a.png")
    np.testing.assert_array_equal(
        images.read_rgb(tmp_path / "a.png"), np.repeat(_rgb()[..., :1], 3, axis=-1)
    )


def test_the_pixels_stay_where_the_sensor_had_them(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6  # turn by 90° for showing; depth images know nothing of it
    Image.fromarray(_rgb()).save(tmp_path / "a.jpg", exif=exif)
    assert images.read_rgb(tmp_path / "a.jpg").shape == (40, 60, 3)


@pytest.mark.parametrize("extension", ["png", "jpg"])
@pytest.mark.parametrize("keep", [0.0, 0.3, 0.9, 0.99])
def test_a_truncated_picture_is_an_error_that_names_it(tmp_path, extension, keep):
    path = tmp_path / f"cut.{extension}"
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)).save(path)
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * keep)])
    with pytest.raises(ValueError, match=rf"cut\.{extension}"):
        images.read_rgb(path)


def test_depth_is_in_metres_and_missing_values_are_zero(tmp_path):
    raw = np.array([[0, 1000, 65535], [500, 1, 20000]], np.uint16)
    cv2.imwrite(str(tmp_path / "d.png"), raw)
    depth = images.read_depth(tmp_path / "d.png", 0.1)
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, [[0, 0.1, 0], [0.05, 0.0001, 2.0]], rtol=1e-6)


@pytest.mark.parametrize(
    ("pixels", "message"),
    [
        (np.full((4, 4), 9, np.uint8), "16-bit"),
        (np.full((4, 4, 3), 9, np.uint16), "16-bit"),
        (np.zeros((4, 4), np.uint16), "no depth"),
        (np.full((4, 4), 65535, np.uint16), "no depth"),
    ],
)
def test_depth_of_another_kind_or_none_is_an_error(tmp_path, pixels, message):
    cv2.imwrite(str(tmp_path / "d.png"), pixels)
    with pytest.raises(ValueError, match=message) as caught:
        images.read_depth(tmp_path / "d.png", 1.0)
    assert "d.png" in str(caught.value)


def test_absent_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="gone"):
        images.read_rgb(tmp_path / "gone")
    with pytest.raises(FileNotFoundError, match="000007"):
        images.find_image(tmp_path, "000007")


@pytest.mark.parametrize(
    "values",
    [None, [1, 2, 3], ["x"] * 9, [np.nan, 0, 3, 0, 5, 3, 0, 0, 1], [0, 0, 3, 0, 5, 3, 0, 0, 1]],
)
def test_impossible_intrinsics_are_refused(tmp_path, values):
    with pytest.raises(ValueError, match=r"camera\.json.*cam_K"):
        images.camera_matrix(values, tmp_path / "camera.json")


def test_sizes_that_differ_are_an_error(tmp_path):
    with pytest.raises(ValueError, match=r"60x40.*30x20"):
        images.same_size(tmp_path / "a.png", _rgb(), np.zeros((20, 30)))
