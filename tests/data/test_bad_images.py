"""Images, depth, LINEMOD's files, folders of frames."""

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bad_input import Case, check, of_file, pixels, written
from hlp.data.images import (
    depth_image_size,
    depth_in_metres,
    guess_unit,
    image_size,
    read_depth,
    read_raw_depth,
    read_rgb,
)
from hlp.data.linemod import read_dpt, read_matrix
from hlp.data.rgbd_frames import RgbdFrames
from hlp.files import read_npz


def rot(path: Path) -> object:
    return read_matrix(path, 9)


NINE = "3 3\n1 0 0\n0 1 0\n0 0 1\n"
LINEMOD: dict[str, Case] = {
    "no dpt": (lambda folder: read_dpt(folder / "a.dpt"), "no depth"),
    "no rot": (lambda folder: rot(folder / "a.rot"), "no pose"),
    "dpt: empty": (of_file(read_dpt, "a.dpt", b""), "truncated or no .dpt"),
    "dpt: short header": (of_file(read_dpt, "a.dpt", b"\1\0\0\0"), "truncated or no .dpt"),
    "dpt: below 0": (of_file(read_dpt, "a.dpt", struct.pack("<ii", -2, -2)), "truncated or no"),
    "dpt: 0 rows": (of_file(read_dpt, "a.dpt", struct.pack("<ii", 0, 4)), "truncated or no .dpt"),
    "dpt: too short": (of_file(read_dpt, "a.dpt", struct.pack("<ii", 2, 2) + b"\1" * 7), "trunc"),
    "dpt: too long": (of_file(read_dpt, "a.dpt", struct.pack("<ii", 2, 2) + b"\1" * 9), "trunc"),
    "dpt: huge": (of_file(read_dpt, "a.dpt", struct.pack("<ii", 2**30, 2**30)), "truncated or no"),
    "rot: empty": (of_file(rot, "a.rot", ""), "9 finite numbers"),
    "rot: header alone": (of_file(rot, "a.rot", "3 3\n"), "9 finite numbers"),
    "rot: eight": (of_file(rot, "a.rot", NINE.replace("0 0 1", "0 1")), "9 finite numbers"),
    "rot: ten": (of_file(rot, "a.rot", NINE + "1"), "9 finite numbers"),
    "rot: NaN": (of_file(rot, "a.rot", NINE.replace("1 0 0", "nan 0 0")), "9 finite numbers"),
    "rot: words": (of_file(rot, "a.rot", NINE.replace("1 0 0", "x 0 0")), "no number"),
    "rot: bytes": (of_file(rot, "a.rot", b"\xff\xfe\n\xff\xff"), "a.rot"),
}


def encoder_frames(**camera: Any) -> Any:
    """A folder of RGB-D frames with this camera.json."""

    def read(folder: Path) -> object:
        for kind, image in (("rgb", np.zeros((8, 8, 3))), ("depth", np.full((8, 8), 900))):
            depth = image.astype(np.uint16 if kind == "depth" else np.uint8)
            written(folder / kind / "1.png", cv2.imencode(".png", depth)[1].tobytes())
        written(folder / "camera.json", json.dumps(camera))
        frames = RgbdFrames(folder)
        return frames.load(frames.keys[0])

    return read


def raw(path: Path) -> object:
    return depth_in_metres(read_raw_depth(path), 1.0, path)


def guessed(path: Path) -> object:
    return guess_unit(read_raw_depth(path), path)


def size(path: Path) -> object:
    return image_size(path, 0.001)


def depth_size(path: Path) -> object:
    return depth_image_size(path, 50.0)


def millimetres(path: Path) -> object:
    return read_depth(path, 1.0)


PNG = cv2.imencode(".png", np.random.default_rng(0).integers(0, 255, (40, 40, 3)))[1].tobytes()
JPG = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (40, 40, 3)))[1].tobytes()


def stated_size(side: int) -> bytes:
    """A PNG whose header states that many pixels a side; it has hardly any."""
    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    chunks = [b"IHDR" + head, b"IDAT" + zlib.compress(bytes(99)), b"IEND"]
    framed = (struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(framed)


def npy(shape: str, values: np.ndarray | None = None) -> bytes:
    """A file of NumPy's whose header states that shape."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return (
        b"\x93NUMPY\x01\x00"
        + struct.pack("<H", len(head))
        + head
        + (b"" if values is None else values.tobytes())
    )


GREY, DEPTH = np.full((8, 8), 9, np.uint8), np.full((8, 8), 900, np.uint16)
IMAGES: dict[str, Case] = {
    "no image": (lambda folder: read_rgb(folder / "a.png"), "no image"),
    "no depth image": (lambda folder: read_raw_depth(folder / "a.png"), "no depth image"),
    "png: empty": (of_file(read_rgb, "a.png", b""), "truncated or no image"),
    "png: text": (of_file(read_rgb, "a.png", "png"), "truncated or no image"),
    "png: half": (of_file(read_rgb, "a.png", PNG[: len(PNG) // 2]), "truncated or no image"),
    "jpg: header": (of_file(read_rgb, "a.jpg", JPG[:20]), "truncated or no image"),
    "header of text": (of_file(size, "a.png", "png"), "truncated or no image"),
    "header of nothing": (of_file(size, "a.png", b""), "truncated or no image"),
    "header cut": (of_file(size, "a.png", PNG[:20]), "truncated or no image"),
    "no header": (lambda folder: size(folder / "a.png"), "no image"),
    "too large": (of_file(size, "a.png", PNG), "raise data.max_megapixels"),
    "depth header of 8 bits": (pixels(depth_size, "a.png", GREY), "16-bit PNG of one channel"),
    "depth header of colours": (of_file(depth_size, "a.png", PNG), "16-bit PNG of one channel"),
    "depth of 8 bits": (pixels(millimetres, "a.png", GREY), "16-bit PNG of one channel"),
    "depth in colours": (of_file(millimetres, "a.png", PNG), "16-bit PNG of one channel"),
    "depth of zeros": (pixels(millimetres, "a.png", DEPTH * 0), "no depth at any pixel"),
    "depth saturated": (pixels(millimetres, "a.png", DEPTH * 0 + 65535), "no depth at any pixel"),
    "own depth of 8 bits": (pixels(raw, "a.png", GREY), "16-bit numbers"),
    "own depth of zeros": (pixels(raw, "a.png", DEPTH * 0), "no depth at any pixel"),
    "own depth nearby": (pixels(raw, "a.png", DEPTH * 0 + 3), "check depth_scale"),
    "own depth far away": (pixels(raw, "a.png", DEPTH * 60), "check depth_scale"),
    "own depth in no unit": (pixels(guessed, "a.png", DEPTH * 60), "give depth_scale"),
    "own depth cut": (of_file(raw, "a.npy", b"\x93NUMPY"), "truncated or no array"),
    "own depth text": (of_file(raw, "a.npy", "1 2 3"), "truncated or no array"),
    "own depth tiff": (of_file(raw, "a.tiff", "II*"), "truncated or no image"),
    "png of 60000 px": (of_file(read_rgb, "a.png", stated_size(60_000)), "too large, or no image"),
    "depth for colours": (pixels(read_rgb, "a.png", DEPTH), "is it a depth image?"),
    "own depth of 60000 px": (of_file(raw, "a.png", stated_size(60_000)), "too large, or no image"),
    "own depth of no shape": (of_file(raw, "a.npy", npy("(10**6, 10**6)")), "no array"),
    "own depth of 1 TB": (of_file(raw, "a.npy", npy("(1000000, 1000000)")), "no array"),
    "own depth with a deep header": (of_file(raw, "a.npy", npy("(" * 3000)), "no array"),
    "own depth out of range": (
        of_file(raw, "a.npy", npy("(8, 8)", np.full(64, 1e300))),
        "nearer than inf m",
    ),
    "arrays cut": (of_file(read_npz, "a.npz", b"PK\3\4"), "damaged"),
    "arrays of text": (of_file(read_npz, "a.npz", "text"), "damaged"),
    "no arrays": (lambda folder: read_npz(folder / "a.npz"), "there is no file"),
    "camera.json: no cam_K": (encoder_frames(depth_scale=1.0), "camera.json: cam_K is missing"),
    "camera.json: words": (encoder_frames(cam_K=["a"] * 9), "cam_K.0 is 'a': it must be a number"),
    "camera.json: no focal length": (encoder_frames(cam_K=[0] * 9), "positive focal lengths"),
    "rooms: no folders": (lambda folder: RgbdFrames(folder).keys, "has no folders rgb and depth"),
}

CASES = {**LINEMOD, **IMAGES}


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(CASES[case], tmp_path)


def test_no_case_is_lost() -> None:
    assert len(CASES) >= 55
