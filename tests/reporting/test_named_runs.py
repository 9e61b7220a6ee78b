from pathlib import Path

import pytest

from hlp.errors import InputError
from hlp.records import TargetScore
from hlp.reporting.mlflow_runs import describe_named
from hlp.results.poses_file import write_scores
from table_text import unpadded


def repeat(folder: Path, *right: bool, vsd: float = float("nan")) -> str:
    """An output folder whose targets are right or wrong by every metric but BOP's."""
    folder.mkdir()
    scores = [
        TargetScore(1, image, 6, True, 0.75, 0.01, 0.1, 0.01, 0.9, each, each, each, 0.5, 0.7, vsd)
        for image, each in enumerate(right)
    ]
    write_scores(folder / "scores.csv", scores, {6: "cat"})
    return str(folder)


def test_of_three_runs_mean_and_standard_deviation_are_told(tmp_path: Path) -> None:
    names = [
        repeat(tmp_path / "a", True, True, True, False, vsd=0.9),
        repeat(tmp_path / "b", True, True, False, False, vsd=0.6),
        repeat(tmp_path / "c", True, True, True, True, vsd=0.3),
    ]
    told = describe_named(f"[{', '.join(names)}]", "sqlite:///none.db", "markdown")
    lines = [unpadded(line) for line in told.splitlines()]
    assert lines[0] == "| run | targets | ADD(-S) | 5cm5deg | IoU.5 | AR |"
    assert lines[2] == f"| {names[0]} | 4 | 0.750 | 0.750 | 0.750 | 0.700 |"
    assert lines[-2:] == [
        "| mean | | 0.750 | 0.750 | 0.750 | 0.600 |",
        "| standard deviation | | 0.2500 | 0.2500 | 0.2500 | 0.1000 |",
    ]


def test_runs_of_other_targets_are_said_to_be(tmp_path: Path) -> None:
    names = [repeat(tmp_path / str(i), *[True] * (1 + i)) for i in range(3)]
    told = describe_named(f"[{','.join(names)}]", "sqlite:///none.db", "text")
    assert "mean" in told and "nan" not in told  # BOP's recalls were not computed
    assert told.endswith("The runs were not asked for the same targets.")


def test_two_are_compared_and_one_is_too_few(tmp_path: Path) -> None:
    first, second = repeat(tmp_path / "a", True, False), repeat(tmp_path / "b", True, True)
    assert "McNemar" in describe_named(f"[{first},{second}]", "sqlite:///none.db", "text")
    with pytest.raises(InputError, match="name two"):
        describe_named(f"[{first}]", "sqlite:///none.db", "text")
