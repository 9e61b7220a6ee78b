import json
import multiprocessing
import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

from hlp.errors import DataError
from hlp.stages.store import StageStore

NAME = "0123456789abcdef"
DESCRIPTION = {"settings": {"k": 3}, "upstream": {"views": "aa"}}


def write(folder: Path) -> None:
    (folder / "data.txt").write_text("done")


def fail_if_called(folder: Path) -> None:
    raise AssertionError(f"made again: {folder}")


def test_makes_once_then_reuses(tmp_path: Path) -> None:
    first = StageStore(tmp_path)
    folder = first.get_or_make("codebook", NAME, write, DESCRIPTION)
    again = StageStore(tmp_path)
    assert again.get_or_make("codebook", NAME, fail_if_called, DESCRIPTION) == folder
    assert folder == tmp_path / "codebook" / NAME
    assert (folder / "data.txt").read_text() == "done"
    assert [event.reused for event in first.events + again.events] == [False, True]
    assert again.events[0].seconds == pytest.approx(first.events[0].seconds, abs=1e-3)


def test_log_and_events_name_the_object(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    store = StageStore(tmp_path)
    with caplog.at_level("INFO"):
        store.get_or_make("views", NAME, write, DESCRIPTION, "cat")
        store.get_or_make("encoder", NAME, write, DESCRIPTION)
    assert [event.of for event in store.events] == ["cat", ""]
    views, encoder = caplog.messages
    assert views.startswith(f"made   views of cat {NAME} (")
    assert encoder.startswith(f"made   encoder {NAME} (")


def test_record_says_what_the_output_was_made_from(tmp_path: Path) -> None:
    folder = StageStore(tmp_path).get_or_make("codebook", NAME, write, DESCRIPTION)
    record = json.loads((folder / "stage.json").read_text())
    assert record["stage"] == "codebook"
    assert record["fingerprint"] == NAME
    assert record["settings"] == {"k": 3}
    assert record["upstream"] == {"views": "aa"}
    assert record["seconds"] >= 0
    assert record["made_at"].endswith("+00:00")
    assert {"python", "hlp", "numpy", "torch"} <= record["versions"].keys()


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_failure_publishes_nothing_and_names_the_folder(
    tmp_path: Path, error: BaseException
) -> None:
    store = StageStore(tmp_path)

    def fail(folder: Path) -> None:
        write(folder)
        raise error

    with pytest.raises(type(error)) as caught:
        store.get_or_make("codebook", NAME, fail, DESCRIPTION)
    assert not (tmp_path / "codebook" / NAME).exists()
    assert str(tmp_path / "codebook" / f"{NAME}.partial") in caught.value.__notes__[0]
    assert store.events == []


def test_interrupted_work_finds_its_own_files(tmp_path: Path) -> None:
    store = StageStore(tmp_path)

    def interrupted(folder: Path) -> None:
        (folder / "epoch-3").touch()
        raise KeyboardInterrupt

    def resumed(folder: Path) -> None:
        assert (folder / "epoch-3").exists()
        (folder / "epoch-4").touch()

    with pytest.raises(KeyboardInterrupt):
        store.get_or_make("encoder", NAME, interrupted, DESCRIPTION)
    folder = store.get_or_make("encoder", NAME, resumed, DESCRIPTION)
    assert {path.name for path in folder.iterdir()} == {"epoch-3", "epoch-4", "stage.json"}
    assert not list(folder.parent.glob("*.partial"))


def test_half_an_output_under_the_final_name_is_refused(tmp_path: Path) -> None:
    (tmp_path / "codebook" / NAME).mkdir(parents=True)
    with pytest.raises(DataError, match=NAME):
        StageStore(tmp_path).get_or_make("codebook", NAME, fail_if_called, DESCRIPTION)


def slow_make(folder: Path) -> None:
    with (folder.parent.parent / "calls").open("a") as calls:
        calls.write(f"{os.getpid()}\n")
    time.sleep(0.3)
    write(folder)


def ask(root: Path, barrier: Any, answers: Any) -> None:
    store = StageStore(root)
    barrier.wait()
    folder = store.get_or_make("codebook", NAME, slow_make, DESCRIPTION)
    answers.put((store.events[0].reused, (folder / "data.txt").read_text()))


def test_runs_at_once_compute_it_once(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    barrier, answers = context.Barrier(4), context.Queue()
    runs = [context.Process(target=ask, args=(tmp_path, barrier, answers)) for _ in range(4)]
    for run in runs:
        run.start()
    found = sorted(answers.get(timeout=60) for _ in runs)
    for run in runs:
        run.join()
    assert found == [(False, "done"), *[(True, "done")] * 3]
    assert len((tmp_path / "calls").read_text().split()) == 1


def die(folder: Path) -> None:
    (folder / "epoch-3").touch()
    os.kill(os.getpid(), signal.SIGKILL)


def ask_and_die(root: Path) -> None:
    StageStore(root).get_or_make("codebook", NAME, die, DESCRIPTION)


def test_a_process_that_died_holds_nobody_up(tmp_path: Path) -> None:
    """Killed while it made the output: its lock file stays, the lock does not."""
    dead = multiprocessing.get_context("spawn").Process(target=ask_and_die, args=(tmp_path,))
    dead.start()
    dead.join(timeout=60)
    assert dead.exitcode == -signal.SIGKILL
    partial = tmp_path / "codebook" / f"{NAME}.partial"
    assert (partial / "epoch-3").exists()
    assert (tmp_path / "codebook" / f"{NAME}.lock").exists()
    with FileLock(tmp_path / "codebook" / f"{NAME}.lock", timeout=0):
        pass
    folder = StageStore(tmp_path).get_or_make("codebook", NAME, write, DESCRIPTION)
    assert {path.name for path in folder.iterdir()} == {"epoch-3", "data.txt", "stage.json"}
