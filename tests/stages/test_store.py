import json
import multiprocessing
import os
import signal
import time
from pathlib import Path

import pytest
from filelock import FileLock

from hlp import fingerprints
from hlp.errors import DataError
from hlp.fingerprints import file_checksum, sealed
from hlp.stages.store import StageStore

NAME = "0123456789abcdef"
DESCRIPTION = {"settings": {"k": 3}, "upstream": {"views": "aa"}}


def write(folder):
    (folder / "data.txt").write_text("done")


def fail_if_called(folder):
    raise AssertionError(f"made again: {folder}")


def ask(root, make=write, stage="codebook", of=""):
    """A store that was asked for one output."""
    store = StageStore(root)
    assert store.get_or_make(stage, NAME, make, DESCRIPTION, of) == root / stage / NAME
    return store


def test_makes_once_then_reuses_and_says_so(tmp_path, caplog):
    with caplog.at_level("INFO"):
        first, again = ask(tmp_path, of="cat"), ask(tmp_path, fail_if_called)
        first.get_or_make("codebook", "of another", write, {})
    folder = tmp_path / "codebook" / NAME
    assert (folder / "data.txt").read_text() == "done"
    assert [(e.reused, e.of) for e in first.events[:1] + again.events] == [
        (False, "cat"),
        (True, ""),
    ]
    assert again.events[0].seconds == pytest.approx(first.events[0].seconds, abs=1e-3)
    step, made, reused, _ = caplog.messages
    assert step.startswith("step 4 of 5, codebook: local patches")
    assert made.startswith(f"made   codebook of cat {NAME} (")
    assert reused.startswith(f"reused codebook {NAME} (") and reused.endswith(" saved)")
    record = json.loads((folder / "stage.json").read_text())
    assert (record["stage"], record["fingerprint"]) == ("codebook", NAME)
    assert record["settings"] == {"k": 3} and record["upstream"] == {"views": "aa"}
    assert record["seconds"] >= 0 and record["made_at"].endswith("+00:00")
    assert {"python", "hlp", "numpy", "torch"} <= record["versions"].keys()


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_interrupted_work_publishes_nothing_and_is_continued(tmp_path, error):
    store = StageStore(tmp_path)

    def fail(folder):
        (folder / "epoch-3").touch()
        (folder / ".data.txt.4711").write_text("half")  # as a killed process leaves it
        raise error

    def resume(folder):
        assert (folder / "epoch-3").exists()
        write(folder)

    with pytest.raises(type(error)) as caught:
        store.get_or_make("codebook", NAME, fail, DESCRIPTION)
    folder = tmp_path / "codebook" / NAME
    assert not folder.exists() and store.events == []
    assert f"{folder}.partial" in caught.value.__notes__[0]
    store.get_or_make("codebook", NAME, resume, DESCRIPTION)
    assert {path.name for path in folder.iterdir()} == {"epoch-3", "data.txt", "stage.json"}
    assert not list(folder.parent.glob("*.partial"))


def flip(path):
    content = bytearray(path.read_bytes())
    content[0] ^= 4
    path.write_bytes(content)


def edit(folder, resealed=False, without=(), **values):
    record = json.loads((folder / "stage.json").read_text()) | values
    record = {key: value for key, value in record.items() if key not in without}
    if resealed:
        del record["checksum"]
        record = sealed(record)
    (folder / "stage.json").write_text(json.dumps(record))


def data(change):
    return lambda folder: change(folder / "data.txt")


def record(text):
    return lambda folder: (folder / "stage.json").write_text(text)


DAMAGE = {
    "file flipped": data(flip),
    "file cut": data(lambda path: path.write_text("don")),
    "file gone": data(Path.unlink),
    "file now a folder": data(lambda path: (path.unlink(), path.mkdir())),
    "record gone": lambda folder: (folder / "stage.json").unlink(),
    "record empty": record(""),
    "record is no object": record("[]"),
    "record nested": record("[" * 100_000),
    "record without checksum": record("{}"),
    "record edited": lambda folder: edit(folder, seconds=99.0),
    "record of another stage": lambda folder: edit(folder, resealed=True, stage="views"),
    "record of another output": lambda folder: edit(folder, resealed=True, fingerprint="f" * 16),
    "record of another kind": lambda folder: edit(folder, resealed=True, seconds="1"),
    "file outside": lambda folder: edit(folder, resealed=True, files={"../../x": "0"}),
    "of an earlier version": lambda folder: edit(folder, without=("files", "checksum")),
}


@pytest.mark.parametrize("how", DAMAGE)
def test_what_is_damaged_is_set_aside_and_made_again(tmp_path, caplog, how):
    ask(tmp_path)
    folder = tmp_path / "codebook" / NAME
    DAMAGE[how](folder)
    store = StageStore(tmp_path)
    assert store.problem("codebook", NAME)
    with pytest.raises(DataError, match=NAME):
        store.take("codebook", NAME, "", reused=True)
    caplog.clear()
    store.get_or_make("codebook", NAME, write, DESCRIPTION)
    assert [event.reused for event in store.events] == [False]
    assert (folder / "data.txt").read_text() == "done"
    assert (folder.parent / f"{NAME}.damaged").is_dir()
    (warning,) = [line.message for line in caplog.records if line.levelname == "WARNING"]
    assert str(folder) in warning and f"{NAME}.damaged" in warning
    assert ask(tmp_path, fail_if_called).events[0].seconds < 1.0


@pytest.mark.parametrize("ending", ["partial", "lock", ""])
@pytest.mark.parametrize(
    "what", ["file", "folder", "link", "link to nowhere", "link within", "pipe"]
)
def test_nothing_in_the_store_leads_out_of_it_or_stays_in_the_way(tmp_path, what, ending):
    """Whatever lies where an output is made: nothing is written elsewhere, and it is made."""
    elsewhere, place = tmp_path / "elsewhere", tmp_path / "codebook" / NAME
    elsewhere.mkdir()
    (elsewhere / "mine").write_text("of the user")
    place.parent.mkdir()
    place = place.with_suffix(f".{ending}" if ending else "")
    make = {
        "file": place.touch,
        "folder": place.mkdir,
        "link": lambda: place.symlink_to(elsewhere),
        "link to nowhere": lambda: place.symlink_to(tmp_path / "nowhere"),
        "link within": lambda: (place.mkdir(), (place / "x").symlink_to(elsewhere / "mine")),
        "pipe": lambda: os.mkfifo(place),
    }
    make[what]()
    ask(tmp_path)
    folder = tmp_path / "codebook" / NAME
    assert (folder / "data.txt").read_text() == "done" and not folder.is_symlink()
    assert [path.name for path in elsewhere.iterdir()] == ["mine"]
    assert (elsewhere / "mine").read_text() == "of the user" and not (tmp_path / "nowhere").exists()


def test_the_lock_of_the_store_makes_no_file_where_a_link_leads(tmp_path):
    (tmp_path / ".in-use").symlink_to(tmp_path / "nowhere")
    ask(tmp_path)
    assert not (tmp_path / "nowhere").exists()


def test_a_finished_output_that_holds_a_link_to_elsewhere_is_made_again(tmp_path):
    ask(tmp_path)
    data = tmp_path / "codebook" / NAME / "data.txt"
    data.rename(tmp_path / "same.txt")
    data.symlink_to(tmp_path / "same.txt")
    ask(tmp_path)
    assert not data.is_symlink()


def test_only_the_last_damaged_output_is_kept(tmp_path):
    for text in ("first", "second"):
        ask(tmp_path)
        (tmp_path / "codebook" / NAME / "data.txt").write_text(text)
    ask(tmp_path)
    (aside,) = (tmp_path / "codebook").glob("*.damaged")
    assert (aside / "data.txt").read_text() == "second"


def test_a_store_reads_every_file_once(tmp_path, monkeypatch):
    ask(tmp_path)
    read = []
    monkeypatch.setattr(
        fingerprints, "file_checksum", lambda path: read.append(path.name) or file_checksum(path)
    )
    store = StageStore(tmp_path)
    for _ in range(3):
        store.get_or_make("codebook", NAME, fail_if_called, DESCRIPTION)
    assert read == ["data.txt"]


def slow_make(folder):
    with (folder.parent.parent / "calls").open("a") as calls:
        calls.write(f"{os.getpid()}\n")
    time.sleep(0.3)
    write(folder)


def ask_at_once(root, barrier, answers):
    barrier.wait()
    answers.put(ask(root, slow_make).events[0].reused)


def die(folder):
    (folder / "epoch-3").touch()
    os.kill(os.getpid(), signal.SIGKILL)


def test_runs_at_once_compute_it_once_and_one_that_died_holds_nobody_up(tmp_path):
    """One is killed while it makes the output: its lock file stays, the lock does not."""
    context = multiprocessing.get_context("spawn")
    dead = context.Process(target=ask, args=(tmp_path, die))
    dead.start()
    dead.join(timeout=60)
    assert dead.exitcode == -signal.SIGKILL
    folder = tmp_path / "codebook" / NAME
    assert folder.with_name(f"{NAME}.lock").exists()
    with FileLock(folder.with_name(f"{NAME}.lock"), timeout=0):
        pass
    barrier, answers = context.Barrier(3), context.Queue()
    runs = [
        context.Process(target=ask_at_once, args=(tmp_path, barrier, answers)) for _ in range(3)
    ]
    for run in runs:
        run.start()
    found = sorted(answers.get(timeout=60) for _ in runs)
    for run in runs:
        run.join()
    assert found == [False, True, True]
    assert len((tmp_path / "calls").read_text().split()) == 1
    assert {path.name for path in folder.iterdir()} == {"epoch-3", "data.txt", "stage.json"}
