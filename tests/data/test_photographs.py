import cv2
import numpy as np
import pytest

from hlp.data.images import list_photographs, load_photographs, random_crops


def _picture(height, width):
    """Red grows to the right, green downwards, blue is constant."""
    y, x = np.mgrid[0:height, 0:width]
    red, green = x * 255 // (width - 1), y * 255 // (height - 1)
    return np.stack([red, green, np.full_like(x, 77)], axis=-1).astype(np.uint8)


def _save(path, picture):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), picture[..., ::-1])


def test_pictures_are_found_at_any_depth_sorted(tmp_path):
    for name in ("b.jpg", "a/c.PNG", "a/deep/d.jpeg"):
        _save(tmp_path / name, _picture(20, 30))
    (tmp_path / "notes.txt").write_text("no picture")
    names = [path.relative_to(tmp_path).as_posix() for path in list_photographs(tmp_path)]
    assert names == ["a/c.PNG", "a/deep/d.jpeg", "b.jpg"]


def test_of_a_voc_set_only_the_photographs_count(tmp_path):
    _save(tmp_path / "VOC2012/JPEGImages/1.jpg", _picture(20, 30))
    _save(tmp_path / "VOC2012/SegmentationClass/1.png", _picture(20, 30))
    assert [path.name for path in list_photographs(tmp_path)] == ["1.jpg"]


def test_no_folder_and_no_pictures_are_errors(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"data\.photographs"):
        list_photographs(tmp_path / "none")
    with pytest.raises(FileNotFoundError, match="no photograph"):
        list_photographs(tmp_path)


def test_loading_shrinks_and_spreads_over_the_list(tmp_path):
    for number in range(10):
        _save(tmp_path / f"{number}.png", np.full((60, 120, 3), number * 20, np.uint8))
    images = load_photographs(list_photographs(tmp_path), limit=4, long_side=40)
    assert [image.shape for image in images] == [(20, 40, 3)] * 4
    assert [int(image[0, 0, 0]) // 20 for image in images] == [0, 3, 6, 9]
    (whole,) = load_photographs(list_photographs(tmp_path)[:1], limit=4, long_side=400)
    assert whole.shape == (60, 120, 3)


def test_crops_are_square_windows_of_the_pictures():
    crops = random_crops([_picture(200, 300)], 200, 64, np.random.default_rng(0))
    assert crops.shape == (200, 64, 64, 3) and crops.dtype == np.uint8
    assert (crops[..., 2] == 77).all()
    middle = crops.astype(float)
    down = middle[:, -1, 32, 1] - middle[:, 0, 32, 1]
    across = middle[:, 32, -1, 0] - middle[:, 32, 0, 0]
    # Green always grows downwards; red grows to the right unless mirrored, half of the time.
    assert (down > 0).all()
    assert 0.35 < (across > 0).mean() < 0.65
    # Square windows: 200 px of 300 across are 2/3 of the red, all of the green.
    np.testing.assert_allclose(np.abs(across) / down, 2 / 3, atol=0.05)
    # Sides between half the size (32 px) and all of the short side (200 px).
    sides = down / 255 * 200
    assert sides.min() < 60 and sides.max() > 180
    assert sides.min() > 28


def test_pictures_smaller_than_the_patch_are_enlarged():
    crops = random_crops([_picture(10, 12)], 20, 64, np.random.default_rng(0))
    assert crops.shape == (20, 64, 64, 3) and (crops[..., 2] == 77).all()


def test_the_generator_decides_the_crops():
    images = [_picture(50, 60), _picture(70, 40)]
    first, again, other = (
        random_crops(images, 9, 16, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
