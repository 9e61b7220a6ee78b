import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import hlp
from hlp.commands.ending import stops_in_one_line


@pytest.fixture(autouse=True)
def interruptible() -> Iterator[None]:
    """Tests in the background of a shell script start with Ctrl-C ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_stopped_command_closes_what_is_open_and_says_one_line(
    number: signal.Signals, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    before, closed = signal.getsignal(signal.SIGTERM), []
    with pytest.raises(SystemExit) as ended, stops_in_one_line():
        try:
            signal.raise_signal(number)
        finally:
            if number == signal.SIGTERM:
                signal.raise_signal(number)  # a second one does not cut the closing short
            closed.append(True)
    assert ended.value.code == code
    assert closed == [True]
    assert capsys.readouterr().err.count("\n") == 1
    assert signal.getsignal(signal.SIGTERM) is before


def test_other_threads_are_left_alone() -> None:
    """Only the main thread may set handlers of signals."""
    done = []

    def work() -> None:
        with stops_in_one_line():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [True]


WORKER = """
import os, sys, time
from hlp.stages.worker_end import ends_with
parent = os.getpid()
if os.fork() == 0:
    ends_with(parent)
    print(os.getpid(), flush=True)
    time.sleep(60)
os.kill(os.getpid(), 9)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs fork")
def test_a_worker_ends_with_its_parent() -> None:
    """The pipe closes when both are gone, long before the worker's work is done."""
    environment = {**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "-c", WORKER],
        env=environment,
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert done.returncode == -signal.SIGKILL
    assert not done.stderr
