"""The log file in a run's output folder."""

import logging
import sys

from hlp.errors import is_expected


class LogFile(logging.FileHandler):
    """A log file that is silent about a full disk.

    Python's own prints a traceback for every message that it cannot write. What matters is what the
    run says, when it cannot write its results either.
    """

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Called by `emit` while it handles an error."""
        error = sys.exc_info()[1]
        if error is None or not is_expected(error):
            super().handleError(record)
