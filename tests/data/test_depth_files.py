import builtins

import cv2
import numpy as np
import pytest

from hlp.data.images import depth_in_metres, guess_unit, read_raw_depth
from hlp.errors import DataError, InputError, MissingDependencyError

METRES = np.array([[0.0, 0.8, 0.9], [1.25, 2.0, 0.5]], np.float32)


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
def test_every_kind_of_file_gives_metres(tmp_path, name, values, scale):
    path = write(tmp_path / name, values)
    raw = read_raw_depth(path)
    guessed, why = guess_unit(raw, path)
    assert guessed == scale
    assert f"depth_scale={scale:g}" in why and ("millimetres" in why) == (scale == 1.0)
    depth = depth_in_metres(raw, guessed, path)
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, METRES, atol=1e-6)


def test_what_means_missing_is_zero(tmp_path):
    raw = np.array([[np.nan, np.inf, -1.0, 0.0, 1.5]], np.float32)
    np.testing.assert_array_equal(depth_in_metres(raw, 1000.0, tmp_path), [[0, 0, 0, 0, 1.5]])
    raw = np.array([[0, 65535, 1500]], np.uint16)
    np.testing.assert_allclose(depth_in_metres(raw, 1.0, tmp_path), [[0, 0, 1.5]])


@pytest.mark.parametrize("values", [np.full((2, 2), 3, np.uint16), np.full((2, 2), 5e4)])
def test_values_that_are_no_distance_ask_for_the_unit(tmp_path, values):
    with pytest.raises(InputError, match="give depth_scale"):
        guess_unit(values, tmp_path / "a.npy")


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_a_unit_that_cannot_be_is_refused(tmp_path, scale):
    with pytest.raises(DataError, match="check depth_scale"):
        depth_in_metres(np.full((2, 2), 800, np.uint16), scale, tmp_path / "a.png")


@pytest.mark.parametrize("raw", [np.zeros((2, 2), np.uint16), np.full((2, 2), np.nan)])
def test_an_image_without_depth_is_named(tmp_path, raw):
    for call in (lambda: guess_unit(raw, tmp_path), lambda: depth_in_metres(raw, 1.0, tmp_path)):
        with pytest.raises(DataError, match="no depth at any pixel"):
            call()


@pytest.mark.parametrize(
    ("name", "values"),
    [("a.png", np.ones((4, 4, 3), np.uint16)), ("a.png", np.ones((4, 4), np.uint8)),
     ("a.npy", np.array(["x"])), ("a.npy", np.ones(4))],
)  # fmt: skip
def test_what_is_no_depth_image_is_named(tmp_path, name, values):
    with pytest.raises(DataError, match=rf"{name}.*one channel of 16-bit"):
        read_raw_depth(write(tmp_path / name, values))


@pytest.mark.parametrize("name", ["a.png", "a.tiff", "a.npy", "a.exr"])
def test_a_truncated_file_is_named(tmp_path, name):
    values = np.random.default_rng(0).integers(500, 900, (40, 50)).astype(np.float32)
    path = write(tmp_path / name, values.astype(np.uint16) if name == "a.png" else values)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 3])
    with pytest.raises(DataError, match=rf"{name}.* is truncated"):
        read_raw_depth(path)
    with pytest.raises(FileNotFoundError, match="no depth image"):
        read_raw_depth(tmp_path / f"none{path.suffix}")


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
