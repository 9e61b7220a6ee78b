"""Hydra's options (-m, --cfg, …) among the overrides."""

from typing import Any

import pytest
import yaml

from hlp.cli import main


def shown(given: list[str], capsys: pytest.CaptureFixture[str]) -> Any:
    main(given)
    return yaml.safe_load(capsys.readouterr().out)


@pytest.mark.parametrize(
    "given",
    [
        ["seed=7", "--cfg", "job", "-p", "seed"],
        ["--cfg", "job", "-p", "seed", "seed=7"],
        ["refinement=icp", "-c", "job", "seed=7", "--package", "seed", "frames=3"],
    ],
)
@pytest.mark.parametrize("command", ["run", "bench", "search"])
def test_they_stand_where_one_likes(
    command: str, given: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    monkeypatch.setattr("sys.argv", ["hlp"])
    assert shown([command, *given], capsys) == 7


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (["-m", "seed=0,1", "--cfg", "job"], "-m and --cfg"),
        (["--info", "config", "seed=1", "--multirun"], "--multirun and --info"),
    ],
)
def test_those_that_exclude_each_other_are_named(
    given: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", *given])
    assert ended.value.code == 1
    said = capsys.readouterr().err
    assert said == f"hlp: {named} exclude each other: leave one out\n"
