"""What is wrong with a configuration is said before any stage runs."""

from collections.abc import Callable
from pathlib import Path

import pytest

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """A data set without any mesh."""
    for folder in ("models", "test", "photos", "rooms"):
        (tmp_path / "lm" / folder).mkdir(parents=True)
    return tmp_path / "lm"


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["sede=1"], ["sede"]),
        (["refinement.partikles=3"], ["refinement.partikles"]),
        (["+data.foo=1"], ["data.foo", "no key"]),
        (["rendering.viewpoints=three"], ["rendering.viewpoints", "whole number", "'three'"]),
        (["encoder=none"], ["encoder=none is no alternative", "contrastive"]),
        (["frames=0"], ["frames is 0"]),
        (["refinement.particles=0"], ["refinement.particles is 0", "at least 1"]),
        (["refinement.phi_1=1.0"], ["refinement.phi_1 + phi_2", "above 4"]),
        (["experiment=linemod_bop"], ["data.root is not set"]),
        (["experiment=linemod_bop", "data.root=nowhere"], ["data.root is no folder", "nowhere"]),
        (
            [
                "experiment=linemod_bop",
                "data.root={root}",
                "data.photographs=null",
                "data.rooms=null",
                "data.rgbd_frames=null",
            ],
            ["no mesh of object 1 (ape)", "obj_000001.ply"],
        ),
    ],
)
def test_wrong_input_is_named_before_any_stage(
    call: Call,
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    overrides: list[str],
    words: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said, error = call(*[each.format(root=dataset) for each in overrides])
    assert code in {1, 2}
    assert said == ""
    assert error.startswith("hlp: ")
    assert error.count("hlp: ") == 1
    assert len(error.splitlines()) <= 12
    for word in words:
        assert word in error
    for word in ("Traceback", "pydantic", "input_value", "full_key"):
        assert word not in error
    assert not (tmp_path / "work").exists()
