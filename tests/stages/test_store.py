import json
import multiprocessing
import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

from hlp import checksums
from hlp.checksums import file_checksum, sealed
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


def flip(path: Path, at: int = 0) -> None:
    content = bytearray(path.read_bytes())
    content[at] ^= 4
    path.write_bytes(content)


DAMAGE = {
    "file flipped": lambda folder: flip(folder / "data.txt"),
    "file cut": lambda folder: (folder / "data.txt").write_text("don"),
    "file empty": lambda folder: (folder / "data.txt").write_text(""),
    "file gone": lambda folder: (folder / "data.txt").unlink(),
    "file now a folder": lambda folder: (
        (folder / "data.txt").unlink(),
        (folder / "data.txt").mkdir(),
    ),
    "record gone": lambda folder: (folder / "stage.json").unlink(),
    "record empty": lambda folder: (folder / "stage.json").write_text(""),
    "record is no object": lambda folder: (folder / "stage.json").write_text("[]"),
    "record nested": lambda folder: (folder / "stage.json").write_text("[" * 100_000),
    "record edited": lambda folder: edit(folder, seconds=99.0),
    "record without checksum": lambda folder: (folder / "stage.json").write_text("{}"),
    "record of another stage": lambda folder: edit(folder, resealed=True, stage="views"),
    "record of another output": lambda folder: edit(folder, resealed=True, fingerprint="f" * 16),
    "file outside": lambda folder: edit(folder, resealed=True, files={"../../x": "0"}),
    "record of an earlier version": lambda folder: drop_checksums(folder),
}


def edit(folder: Path, resealed: bool = False, **values: Any) -> None:
    record = json.loads((folder / "stage.json").read_text()) | values
    if resealed:
        del record["checksum"]
        record = sealed(record)
    (folder / "stage.json").write_text(json.dumps(record))


def drop_checksums(folder: Path) -> None:
    record = json.loads((folder / "stage.json").read_text())
    old = {key: value for key, value in record.items() if key not in ("files", "checksum")}
    (folder / "stage.json").write_text(json.dumps(old))


@pytest.mark.parametrize("how", DAMAGE)
def test_what_is_damaged_is_set_aside_and_made_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, how: str
) -> None:
    folder = StageStore(tmp_path).get_or_make("codebook", NAME, write, DESCRIPTION)
    DAMAGE[how](folder)
    store = StageStore(tmp_path)
    assert not store.holds("codebook", NAME)
    with pytest.raises(DataError, match=NAME):
        store.take("codebook", NAME, "", reused=True)
    caplog.clear()
    store.get_or_make("codebook", NAME, write, DESCRIPTION)
    assert [event.reused for event in store.events] == [False]
    assert (folder / "data.txt").read_text() == "done"
    assert (folder.parent / f"{NAME}.damaged").is_dir()
    (warning,) = [each.message for each in caplog.records if each.levelname == "WARNING"]
    assert str(folder) in warning
    assert f"{NAME}.damaged" in warning
    again = StageStore(tmp_path)
    again.get_or_make("codebook", NAME, fail_if_called, DESCRIPTION)
    assert again.events[0].seconds < 1.0


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"seconds": "1"}, "seconds is '1': it must be a number"),
        ({"seconds": None}, "seconds is null: it must be a number"),
        ({"seconds": -1.0}, "seconds is -1.0: it must be greater than or equal to 0"),
        ({"files": ["data.txt"]}, "files is ['data.txt']: it must be an object"),
        ({"files": {"data.txt": 1}}, "files.data.txt is 1: it must be text"),
        ({"stage": 7}, "stage is 7: it must be text"),
    ],
)
def test_a_record_that_is_not_as_its_schema_is_named(
    tmp_path: Path, values: dict[str, Any], words: str
) -> None:
    folder = StageStore(tmp_path).get_or_make("codebook", NAME, write, DESCRIPTION)
    edit(folder, resealed=True, **values)
    with pytest.raises(DataError) as caught:
        StageStore(tmp_path).read_record("codebook", NAME)
    assert str(caught.value).startswith(f"{folder / 'stage.json'}: {words}")


@pytest.mark.parametrize("what", ["empty folder", "file", "link to nowhere"])
def test_what_no_store_wrote_is_set_aside(tmp_path: Path, what: str) -> None:
    folder = tmp_path / "codebook" / NAME
    folder.parent.mkdir()
    {
        "empty folder": folder.mkdir,
        "file": folder.touch,
        "link to nowhere": lambda: folder.symlink_to(tmp_path / "nowhere"),
    }[what]()
    StageStore(tmp_path).get_or_make("codebook", NAME, write, DESCRIPTION)
    assert (folder / "data.txt").read_text() == "done"


def test_only_the_last_damaged_output_is_kept(tmp_path: Path) -> None:
    for text in ("first", "second"):
        folder = StageStore(tmp_path).get_or_make("codebook", NAME, write, DESCRIPTION)
        (folder / "data.txt").write_text(text)
    StageStore(tmp_path).get_or_make("codebook", NAME, write, DESCRIPTION)
    (aside,) = folder.parent.glob("*.damaged")
    assert (aside / "data.txt").read_text() == "second"


def test_a_store_reads_every_file_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    StageStore(tmp_path).get_or_make("codebook", NAME, write, DESCRIPTION)
    read = []
    monkeypatch.setattr(
        checksums, "file_checksum", lambda path: read.append(path.name) or file_checksum(path)
    )
    store = StageStore(tmp_path)
    for _ in range(3):
        store.get_or_make("codebook", NAME, fail_if_called, DESCRIPTION)
    assert read == ["data.txt"]


def test_what_a_killed_process_was_writing_is_not_published(tmp_path: Path) -> None:
    def make(folder: Path) -> None:
        (folder / ".data.txt.4711").write_text("half")
        write(folder)

    folder = StageStore(tmp_path).get_or_make("codebook", NAME, make, DESCRIPTION)
    assert {path.name for path in folder.iterdir()} == {"data.txt", "stage.json"}


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
