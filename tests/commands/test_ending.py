import errno
import logging
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from yaml import YAMLError

from hlp.commands.ending import fails_in_one_line, messages_on, stops_in_one_line
from hlp.errors import InputError
from new_process import run_python


@pytest.fixture(autouse=True)
def interruptible() -> Iterator[None]:
    """Tests in the background of a shell script start with Ctrl-C ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("continues", [True, False])
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_stopped_command_closes_what_is_open_and_says_one_line(
    number: signal.Signals, code: int, continues: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    before, closed = signal.getsignal(signal.SIGTERM), []
    with pytest.raises(SystemExit) as ended, stops_in_one_line(continues), fails_in_one_line():
        try:
            signal.raise_signal(number)
        finally:
            if number == signal.SIGTERM:
                signal.raise_signal(number)  # a second one does not cut the closing short
            closed.append(True)
    assert ended.value.code == code
    assert closed == [True]
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and ("continues from here" in said) == continues
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize(
    "error", [InputError("no such mesh"), OSError(errno.ENOSPC, "no space left"), YAMLError("bad")]
)
def test_an_expected_error_is_a_line_with_its_notes(
    error: Exception, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    error.add_note("while reading")
    with pytest.raises(SystemExit) as ended, fails_in_one_line():
        raise error
    assert ended.value.code == 1
    assert capsys.readouterr().err == f"hlp: {error}\nwhile reading\n"
    monkeypatch.setenv("HLP_TRACEBACK", "1")
    with pytest.raises(type(error)), fails_in_one_line():
        raise error


@pytest.mark.parametrize("torch", [None, "there"])  # without it, only what finds is installed
def test_a_missing_library_is_a_line_where_it_was_left_out(torch, monkeypatch) -> None:
    monkeypatch.setattr("hlp.commands.ending.find_spec", {"torch": torch}.get)
    with pytest.raises(ModuleNotFoundError if torch else SystemExit), fails_in_one_line():
        raise ModuleNotFoundError("no mlflow", name="mlflow")


def test_a_line_of_an_error_is_as_long_as_can_be_read(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit), fails_in_one_line():
        raise InputError("it is " + "x" * 5_000_000 + ": leave it out")
    said = capsys.readouterr().err
    assert len(said) < 700 and said.startswith("hlp: it is xx") and said.endswith("leave it out\n")


def test_a_bug_keeps_its_traceback() -> None:
    with pytest.raises(KeyError), fails_in_one_line():
        {}["bug"]


@pytest.mark.parametrize("stream", ["stdout", "stderr", ""])
def test_messages_appear_on_one_stream(stream: str, capsys: pytest.CaptureFixture[str]) -> None:
    logger = logging.getLogger("hlp.of_this_test")
    before = logging.getLogger("hlp").level
    with messages_on(stream):
        logger.info("%d views", 3)
        for number in (1, 2, 1):  # a command may look twice into what is broken
            logger.warning("left out: %d", number)
    logger.info("unheard")
    said, words = capsys.readouterr(), "3 views\nleft out: 1\nleft out: 2\n"
    assert said.out == (words if stream == "stdout" else "")
    if stream:
        assert said.err == (words if stream == "stderr" else "")
    assert logging.getLogger("hlp").level == before


@pytest.mark.parametrize(("task", "code"), [("print('x' * size)", 141), ("raise error", 1)])
@pytest.mark.parametrize("size", [10, 10**6])
def test_a_command_ends_without_a_word_where_its_output_is_read_no_more(
    task: str, code: int, size: int
) -> None:
    """Also where the output fits the pipe. Another broken pipe is a bug."""
    program = f"""
import sys
sys.stdin.readline()
from hlp.commands.ending import stops_in_one_line
size, error = {size}, BrokenPipeError("of a worker")
with stops_in_one_line():
    {task}
"""
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=pipe, stdout=pipe, stderr=pipe, text=True
    ) as process:
        assert process.stdout is not None
        if code == 141:
            process.stdout.close()
            process.stdout = None
        _, said = process.communicate("go\n")
    assert process.returncode == code
    assert ("of a worker" in said) if code == 1 else (said == "")


WORKER = """
import os, sys, time
from hlp.stages.executor_settings import ends_with
parent = os.getpid()
if os.fork() == 0:
    ends_with(parent)
    print(os.getpid(), flush=True)
    time.sleep(60)
os.kill(os.getpid(), 9)
"""


def test_a_worker_ends_with_its_parent() -> None:
    """The pipe closes when both are gone, long before the worker's work is done."""
    done = run_python(WORKER)
    assert done.returncode == -signal.SIGKILL
    assert not done.stderr
