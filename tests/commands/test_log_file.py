import logging
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from hlp.commands.log_file import LogFile


@pytest.fixture
def logger() -> Iterator[logging.Logger]:
    logger = logging.Logger("of this test")
    yield logger
    for handler in logger.handlers:
        with suppress(OSError):  # what could not be written cannot be written now
            handler.close()


def test_a_full_disk_hides_nothing_else(
    logger: logging.Logger, capsys: pytest.CaptureFixture[str]
) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    logger.addHandler(LogFile("/dev/full"))
    logger.warning("cannot be written")
    assert capsys.readouterr().err == ""


def test_a_message_with_a_bug_shows_where_it_is(
    logger: logging.Logger, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logger.addHandler(LogFile(tmp_path / "log"))
    logger.warning("%d poses", "three")
    assert "Traceback" in capsys.readouterr().err
    logger.warning("%d poses", 3)
    assert (tmp_path / "log").read_text() == "3 poses\n"
