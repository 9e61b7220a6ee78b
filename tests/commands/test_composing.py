"""Hydra's options (-m, --cfg, …) among the overrides, and the log file in a run's folder."""

import logging
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import yaml

from hlp.cli import main
from hlp.commands.composing import LogFile

Out = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    "given",
    [
        ["run", "seed=7", "--cfg", "job", "-p", "seed"],
        ["bench", "--cfg", "job", "-p", "seed", "seed=7"],
        ["search", "refinement=icp", "-c", "job", "seed=7", "--package", "seed", "frames=3"],
    ],
)
def test_options_stand_where_one_likes(
    given: list[str], capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["hlp"])
    main(given)
    assert yaml.safe_load(capsys.readouterr().out) == 7


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (["-m", "seed=0,1", "--cfg", "job"], "-m and --cfg"),
        (["--info", "config", "seed=1", "--multirun"], "--multirun and --info"),
    ],
)
def test_options_that_exclude_each_other_are_named(
    given: list[str], named: str, capsys: Out
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", *given])
    assert ended.value.code == 1
    assert capsys.readouterr().err == f"hlp: {named} exclude each other: leave one out\n"


@pytest.fixture
def logger() -> Iterator[logging.Logger]:
    logger = logging.Logger("of this test")
    yield logger
    for handler in logger.handlers:
        with suppress(OSError):  # what could not be written cannot be written now
            handler.close()


def test_a_full_disk_hides_nothing_else(logger: logging.Logger, capsys: Out) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    logger.addHandler(LogFile("/dev/full"))
    logger.warning("cannot be written")
    assert capsys.readouterr().err == ""


def test_a_message_with_a_bug_shows_where_it_is(
    logger: logging.Logger, tmp_path: Path, capsys: Out
) -> None:
    logger.addHandler(LogFile(tmp_path / "log"))
    logger.warning("%d poses", "three")
    assert "Traceback" in capsys.readouterr().err
    logger.warning("%d poses", 3)
    assert (tmp_path / "log").read_text() == "3 poses\n"
