"""Progress of long work, on a terminal and in a file."""

import io
import logging
import sys
import threading
import time

from hlp import progress
from hlp.progress import Progress


def test_a_file_gets_lines_while_an_item_lasts_and_a_terminal_a_bar(monkeypatch, caplog, capsys):
    monkeypatch.setattr(progress, "_SILENCE", 0.02)
    caplog.set_level(logging.INFO, "hlp")
    for _ in Progress("abc", "cups drawn", unit="cup"):
        time.sleep(0.1)
    for thread in threading.enumerate():  # which may just be about to write its last line
        if "_speak" in thread.name:
            thread.join()
    count = len(caplog.messages)
    assert caplog.messages[0].startswith("cups drawn: 0 of 3 in 00:00, ")
    assert any("cups drawn: 2 of 3" in line and "left" in line for line in caplog.messages)
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(sys, "stderr", terminal := io.StringIO())
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    for bar, drawn in ((False, False), (True, True)):
        with Progress(None, "cups", 2, unit="cup", bar=bar) as shown:
            shown.update(2)
            time.sleep(0.1)
        assert ("2/2" in terminal.getvalue()) is drawn and len(caplog.messages) == count
