"""Intrinsics in all forms."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bad_input import DEEP, Case, check, of_file
from hlp.data.camera_files import read_camera


def intrinsics(content: Any, name: str = "k.json") -> Any:
    text = content if isinstance(content, str | bytes) else json.dumps(content)
    return of_file(lambda path: read_camera(str(path)), name, text)


K = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]
INTRINSICS: dict[str, Case] = {
    "no intrinsics": (lambda folder: read_camera(str(folder / "k.json")), "is no file"),
    "numbers: three": (lambda _: read_camera([1, 2, 3]), "nine numbers"),
    "numbers: none": (lambda _: read_camera([]), "nine numbers"),
    "numbers: no focal length": (lambda _: read_camera([0, 500, 320, 240]), "positive focal"),
    "numbers: NaN": (lambda _: read_camera([float("nan"), 500, 320, 240]), "finite numbers"),
    "K: empty file": (intrinsics(""), "k.json"),
    "K: null": (intrinsics("null"), "neither keys nor nine"),
    "K: text": (intrinsics('"K"'), "neither keys nor nine"),
    "K: no JSON": (intrinsics("{"), "k.json is no JSON"),
    "K: bytes": (intrinsics(b"\xff\xfe\xfa"), "is no text"),
    "K: deep": (intrinsics(DEEP), "nested deeper"),
    "K: deep YAML": (intrinsics("K: " + "[" * 5000, "k.yaml"), "k.yaml is nested too deeply"),
    "K: an alias": (intrinsics("a: &a [1, 1]\nK: [*a, *a]\n", "k.yaml"), "refers to itself"),
    "K: no keys": (intrinsics({}), "no cam_K"),
    "K: other keys": (intrinsics({"focal": 500}), "no cam_K"),
    "K: eight": (intrinsics({"cam_K": K[:8]}), "nine numbers"),
    "K: null numbers": (intrinsics({"cam_K": None}), "nine numbers"),
    "K: words": (intrinsics({"cam_K": ["f"] * 9}), "9 numbers"),
    "K: an object": (intrinsics({"cam_K": {"fx": 1}}), "nine numbers"),
    "K: ragged": (intrinsics({"cam_K": [[1, 2, 3], [4, 5], [6]]}), "nine numbers"),
    "K: columns": (
        intrinsics({"cam_K": np.reshape(K, (3, 3)).T.ravel().tolist()}),
        "is no camera matrix",
    ),
    "K: skewed last row": (intrinsics({"cam_K": [*K[:8], 2.0]}), "is no camera matrix"),
    "K: negative": (intrinsics({"cam_K": [-500.0, *K[1:]]}), "positive focal"),
    "K: null focal length": (intrinsics({"fx": None, "fy": 1, "cx": 1, "cy": 1}), "K.json"[1:]),
    "K: depth_scale 0": (intrinsics({"cam_K": K, "depth_scale": 0}), "must be a positive number"),
    "K: depth_scale text": (intrinsics({"cam_K": K, "depth_scale": "1"}), "a positive number"),
    "K: width 0": (intrinsics({"cam_K": K, "width": 0, "height": 480}), "give pixels"),
    "K: width text": (intrinsics({"cam_K": K, "width": "a", "height": 480}), "give pixels"),
    "K: no height": (intrinsics({"cam_K": K, "width": 640}), "give pixels"),
    "K: distortion in words": (intrinsics({"cam_K": K, "D": ["a"]}), "must be numbers"),
    "K: three coefficients": (intrinsics({"cam_K": K, "D": [1, 1, 1]}), "3 distortion coeff"),
    "K: unknown model": (
        intrinsics({"cam_K": K, "D": [0.1] * 4, "distortion_model": "magic"}),
        "cannot be undone",
    ),
    "K: several cameras": (
        intrinsics({"0": {"cam_K": K}, "1": {"cam_K": [501.0, *K[1:]]}}),
        "several cameras",
    ),
    "K: null frame": (intrinsics({"0": None}), "no cam_K"),
    "K: Open3D of 8": (intrinsics({"intrinsic_matrix": K[:8]}), "nine numbers"),
    "K: words in text": (intrinsics("fx fy cx cy", "k.txt"), "k.txt"),
    "K: five numbers": (intrinsics("1 2 3 4 5", "k.txt"), "nine numbers"),
}

CASES = {**INTRINSICS}


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(CASES[case], tmp_path)


def test_no_case_is_lost() -> None:
    assert len(CASES) >= 37
