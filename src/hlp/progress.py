"""Progress of long work: a bar on a terminal; elsewhere, as in a file, a line every ten seconds."""

import io
import logging
import sys
import threading
from typing import Any

from tqdm import tqdm

_SILENCE = 10.0  # s
_LINE = "{desc}: {n_fmt} of {total_fmt} in {elapsed}, {rate_fmt}, {remaining} left"
_logger = logging.getLogger(__name__)


class Progress(tqdm):  # type: ignore[misc]
    """A bar of tqdm's; where there is no terminal, lines of the log, also while one item lasts.

    `bar` is off where something else shows one on the terminal.
    """

    def __init__(self, items: Any, desc: str, total: Any = None, *, unit: str, bar: bool = True):
        self._over, self._terminal = threading.Event(), sys.stderr.isatty()
        file, line = (None, None) if self._terminal else (io.StringIO(), _LINE)
        off = self._terminal and not bar
        super().__init__(items, desc, total, unit=unit, file=file, bar_format=line, disable=off)
        if not self._terminal:
            threading.Thread(target=self._speak, daemon=True).start()

    def _speak(self) -> None:
        while not self._over.wait(_SILENCE):
            _logger.info("%s", str(self))

    def display(self, msg: str | None = None, pos: int | None = None) -> bool:
        """Draw the bar on a terminal."""
        return bool(super().display(msg, pos)) if self._terminal else True

    def close(self) -> None:
        """End it, and its lines."""
        self._over.set()
        super().close()
