"""Colour and depth images, good and bad."""

import builtins
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from bad_input import Case, check, of_file, pixels
from hlp.data import images
from hlp.data.images import (
    depth_metres,
    find_image,
    guess_unit,
    image_size,
    list_photographs,
    photograph_crops,
    random_crops,
    read_raw_depth,
    read_rgb,
)
from hlp.errors import MissingDependencyError
from hlp.schemas import require_depths

METRES = np.array([[0.0, 0.8, 0.9], [1.25, 2.0, 0.5]], np.float32)
NOISE = np.random.default_rng(0).integers(0, 255, (40, 60, 3), dtype=np.uint8)


@pytest.mark.parametrize("image", [NOISE, NOISE[..., 0]])
def test_colours_come_as_rgb_and_grey_gets_three_channels(tmp_path, image):
    Image.fromarray(image).save(tmp_path / "a.png")
    expected = image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=-1)
    np.testing.assert_array_equal(read_rgb(tmp_path / "a.png"), expected)
    assert image_size(tmp_path / "a.png", 1.0) == (60, 40)


def test_the_pixels_stay_where_the_sensor_had_them(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6  # turn by 90° for showing; depth images know nothing of it
    Image.fromarray(NOISE).save(tmp_path / "a.jpg", exif=exif)
    assert read_rgb(tmp_path / "a.jpg").shape == (40, 60, 3)
    assert find_image(tmp_path, "a") == tmp_path / "a.jpg"
    assert find_image(tmp_path, "b") == tmp_path / "b.png"


@pytest.mark.parametrize("extension", ["png", "jpg"])
@pytest.mark.parametrize("keep", [0.0, 0.3, 0.9, 0.99])
def test_a_truncated_picture_is_an_error_that_names_it(tmp_path, extension, keep):
    path = tmp_path / f"cut.{extension}"
    Image.fromarray(NOISE).save(path)
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * keep)])
    with pytest.raises(ValueError, match=rf"cut\.{extension}"):
        read_rgb(path)


def write(path, values):
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".exr":
        exr = pytest.importorskip("OpenEXR")
        exr.File({"type": exr.scanlineimage}, {"Z": values}).write(str(path))
    else:
        assert cv2.imwrite(str(path), values)
    return path


@pytest.mark.parametrize(
    ("name", "values", "scale"),
    [
        ("a.png", np.rint(METRES * 1000).astype(np.uint16), 1.0),
        ("a.tiff", np.rint(METRES * 1000).astype(np.uint16), 1.0),
        ("a.tiff", METRES, 1000.0),
        ("a.tiff", METRES * 1000, 1.0),
        ("a.npy", METRES.astype(np.float64), 1000.0),
        ("a.npy", (METRES * 1000)[..., None], 1.0),
        ("a.npy", np.rint(METRES * 1000).astype(np.int32), 1.0),
        ("a.exr", METRES, 1000.0),
    ],
)
def test_every_kind_of_depth_file_gives_metres(tmp_path, name, values, scale):
    path = write(tmp_path / name, values)
    raw = read_raw_depth(path)
    guessed, why = guess_unit(raw, path)
    assert guessed == scale
    assert f"depth_scale={scale:g}" in why and ("millimetres" in why) == (scale == 1.0)
    depth = depth_metres(raw, guessed, path)
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, METRES, atol=1e-6)


def test_what_means_missing_is_zero(tmp_path):
    raw = np.array([[np.nan, np.inf, -1.0, 0.0, 1.5]], np.float32)
    np.testing.assert_array_equal(depth_metres(raw, 1000.0, tmp_path), [[0, 0, 0, 0, 1.5]])
    path = write(tmp_path / "d.png", np.array([[0, 1000, 65535], [500, 1, 20000]], np.uint16))
    depth = depth_metres(read_raw_depth(path), 0.1, path)
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, [[0, 0.1, 0], [0.05, 0.0001, 2.0]], rtol=1e-6)


@pytest.mark.parametrize("name", ["a.png", "a.tiff", "a.npy", "a.exr"])
def test_a_truncated_depth_file_is_named(tmp_path, name):
    values = np.random.default_rng(0).integers(500, 900, (40, 50)).astype(np.float32)
    path = write(tmp_path / name, values.astype(np.uint16) if name == "a.png" else values)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 3])
    with pytest.raises(ValueError, match=rf"{name}.* is truncated"):
        read_raw_depth(path)


def test_without_the_package_exr_says_what_to_install(tmp_path, monkeypatch):
    path = tmp_path / "a.exr"
    path.write_bytes(b"")
    whole = builtins.__import__

    def imported(name, *rest):
        if name == "OpenEXR":
            raise ImportError(name)
        return whole(name, *rest)

    monkeypatch.setattr(builtins, "__import__", imported)
    with pytest.raises(MissingDependencyError, match="OpenEXR"):
        read_raw_depth(path)


def own(path: Path) -> object:
    depth = depth_metres(read_raw_depth(path), 1.0, path)
    require_depths(depth, str(path))
    return depth


def guessed(path: Path) -> object:
    return guess_unit(read_raw_depth(path), path)


def size(path: Path) -> object:
    return image_size(path, 0.001)


def depth_size(path: Path) -> object:
    return image_size(path, 50.0, depth=True)


PNG = cv2.imencode(".png", NOISE)[1].tobytes()


def stated_size(side: int) -> bytes:
    """A PNG whose header states that many pixels a side; it has hardly any."""
    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    chunks = [b"IHDR" + head, b"IDAT" + zlib.compress(bytes(99)), b"IEND"]
    framed = (struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(framed)


def npy(shape: str, values: Any = b"") -> bytes:
    """A file of NumPy's whose header states that shape."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + bytes(values)


JPEG = cv2.imencode(".jpg", np.zeros((8, 16), np.uint8))[1].tobytes()
JPEG = JPEG.replace(struct.pack(">HH", 8, 16), struct.pack(">HH", 30_000, 30_000), 1)
GREY, DEPTH = np.full((8, 8), 9, np.uint8), np.full((8, 8), 900, np.uint16)
CASES: dict[str, Case] = {
    "no image": (lambda folder: read_rgb(folder / "a.png"), "no image"),
    "no depth image": (lambda folder: read_raw_depth(folder / "a.npy"), "no image"),
    **{
        f"png of {side} px": (of_file(read_rgb, "a.png", stated_size(side)), "too large, or no")
        for side in (60_000, 15_000)
    },
    "jpeg of 30,000 px": (of_file(read_rgb, "a.jpg", JPEG), "too large, or no image"),
    "depth for colours": (pixels(read_rgb, "a.png", DEPTH), "is it a depth image?"),
    "header of text": (of_file(size, "a.png", "png"), "truncated or no image"),
    "too large": (of_file(size, "a.png", PNG), "of 60x40 with more than 0.001 megapixels"),
    "bomb": (of_file(size, "a.png", stated_size(60_000)), "raise data.max_megapixels"),
    "depth header of 8 bits": (pixels(depth_size, "a.png", GREY), "16-bit PNG of one channel"),
    "own depth of 8 bits": (pixels(own, "a.png", GREY), "16-bit numbers"),
    "own depth in colours": (pixels(own, "a.png", np.dstack([DEPTH] * 3)), "one channel of 16"),
    "own depth in one row": (of_file(own, "a.npy", npy("(8,)", np.ones(8))), "one channel of 16"),
    "own depth of zeros": (pixels(own, "a.png", DEPTH * 0), "no depth at any pixel"),
    "own depth saturated": (pixels(own, "a.png", DEPTH * 0 + 65535), "no depth at any pixel"),
    "own depth without a unit": (pixels(guessed, "a.png", DEPTH * 0), "no depth at any pixel"),
    "own depth nearby": (pixels(own, "a.png", DEPTH * 0 + 3), "or is depth_scale"),
    "own depth far away": (pixels(own, "a.png", DEPTH * 60), "or is depth_scale"),
    "own depth in no unit": (pixels(guessed, "a.png", DEPTH * 60), "give depth_scale"),
    "own depth in whole metres": (pixels(guessed, "a.png", DEPTH * 0 + 3), "give depth_scale"),
    "own depth of no shape": (of_file(own, "a.npy", npy("(10**6, 10**6)")), "no array"),
    "own depth with a deep header": (of_file(own, "a.npy", npy("(" * 3000)), "no array"),
    "own depth beyond": (of_file(own, "a.npy", npy("(8, 8)", np.full(64, 1e300))), "than 0 m"),
    "own depth of nearly 0": (of_file(own, "a.npy", npy("(8,8)", np.full(64, 1e-99))), "than 0 m"),
    "a PNG cut": (of_file(read_rgb, "a.png", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\xff"), "truncated"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(CASES[case], tmp_path)


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


def test_loading_shrinks_and_spreads_over_the_list(tmp_path, monkeypatch):
    """Four of ten pictures, whose brightness says which, at a third of their size."""
    for number in range(10):
        _save(tmp_path / f"{number}.png", np.full((60, 120, 3), number * 20, np.uint8))
    monkeypatch.setattr(images, "_MOST", 4)
    monkeypatch.setattr(images, "_LONG_SIDE", 40)
    crops = photograph_crops(tmp_path, 50, 20, np.random.default_rng(0))
    assert {int(crop[0, 0, 0]) // 20 for crop in crops} == {0, 3, 6, 9}
    assert images._shrink(_picture(60, 120)).shape == (20, 40, 3)
    assert images._shrink(_picture(20, 30)).shape == (20, 30, 3)


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
