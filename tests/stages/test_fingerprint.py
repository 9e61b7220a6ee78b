import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from hlp import source_code
from hlp.source_code import Code
from hlp.stages.fingerprint import fingerprint, plain, stage_code


@dataclass(frozen=True)
class Pso:
    particles: int
    step_deg: float


@dataclass(frozen=True)
class Icp:
    particles: int
    step_deg: float


BASE = {
    "stage": "codebook",
    "code": Code("0123", {"numpy": "2.4.6"}),
    "seed": 0,
    "settings": {"encoder": {"width": 32, "levels": [1, 2]}, "k": 3},
    "upstream": {"views": "0123456789abcdef"},
}


def test_is_sixteen_hex_digits_and_the_same_in_another_process() -> None:
    here = fingerprint(**BASE)
    code = (
        "from hlp.source_code import Code; from hlp.stages.fingerprint import fingerprint; "
        f"print(fingerprint(**{BASE!r}))"
    )
    there = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()
    assert len(here) == 16
    assert int(here, 16) >= 0
    assert here == there


@pytest.mark.parametrize(
    "change",
    [
        {"stage": "encoder"},
        {"code": Code("0124", {"numpy": "2.4.6"})},
        {"code": Code("0123", {"numpy": "2.4.7"})},
        {"seed": 1},
        {"settings": {"encoder": {"width": 32, "levels": [2, 1]}, "k": 3}},
        {"settings": {"encoder": {"width": 32, "levels": [1, 2]}, "k": 3.5}},
        {"settings": {"encoder": {"width": 32, "levels": [1, 2]}, "k": "3"}},
        {"settings": {"encoder": {"width": 32, "levels": [1, 2], "k": 3}}},
        {"upstream": {"views": "0123456789abcdee"}},
        {"upstream": {"frames": "0123456789abcdef"}},
        {"upstream": {}},
    ],
    ids=str,
)
def test_every_ingredient_counts(change: dict[str, object]) -> None:
    assert fingerprint(**(BASE | change)) != fingerprint(**BASE)


def test_order_of_keys_and_kind_of_sequence_do_not_count() -> None:
    settings = {"k": 3, "encoder": {"levels": (1, 2), "width": np.int64(32)}}
    assert fingerprint(**(BASE | {"settings": settings})) == fingerprint(**BASE)


def test_alternatives_with_equal_fields_differ() -> None:
    assert plain(Pso(25, 5.0)) != plain(Icp(25, 5.0))
    assert plain(Pso(25, 5.0)) == plain(Pso(25, 5.0))


def test_paths_numpy_scalars_and_infinity_have_a_plain_form() -> None:
    assert plain({"a": Path("x") / "y", "b": np.float32(0.5), "c": np.bool_(True)}) == {
        "a": "x/y",
        "b": 0.5,
        "c": True,
    }
    limits = [BASE | {"settings": {"threshold": float(f"{sign}inf")}} for sign in "+-"]
    assert fingerprint(**limits[0]) != fingerprint(**limits[1])


def test_nan_is_refused_and_the_key_named() -> None:
    with pytest.raises(ValueError, match=r"settings\.step_deg is NaN"):
        plain(Pso(25, float("nan")))
    with pytest.raises(ValueError, match=r"settings\.a\[1\] is NaN"):
        plain({"a": [0.0, np.float64("nan")]})


@pytest.mark.parametrize(
    "value",
    [np.zeros(2), {1, 2}, object(), Pso, {1: "one"}],
    ids=["array", "set", "object", "class", "key"],  # the same in every worker
)
def test_what_has_no_plain_form_is_refused(value: object) -> None:
    with pytest.raises(TypeError, match=r"settings\.bad"):
        plain({"bad": value})


def test_a_stages_code_is_what_its_modules_import_and_not_the_settings_of_other_stages() -> None:
    """A change of the refiner renders no views and trains no classifier."""
    names, _ = source_code._closure(
        ("hlp.method.learn.classifier_training",),
        ("hlp.method.settings", "hlp.method.stage_settings"),
    )
    assert not [name for name in names if name.startswith(("hlp.refinement", "hlp.voting"))]
    assert {
        "hlp.patches.holistic_pool",
        "hlp.models.classifier_training",
        "hlp.method.learn.training",
    } <= {*names}
    whole = source_code.code_of("hlp.method.learn.classifier_training")
    assert stage_code("hlp.method.learn.classifier_training").source != whole.source
