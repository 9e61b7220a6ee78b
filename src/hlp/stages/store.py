"""Outputs of stages on disk, each in a folder named after its fingerprint.

<root>/<stage>/<fingerprint>/          finished: never changed again
<root>/<stage>/<fingerprint>.partial/  begun, not finished
<root>/<stage>/<fingerprint>.lock      held by the run that is making it
"""

import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from hlp.errors import DataError
from hlp.files import read_json, write_json
from hlp.stages.fingerprint import plain
from hlp.stages.provenance import library_versions

RECORD = "stage.json"


@dataclass(frozen=True)
class StageEvent:
    """One stage output that a run requested; `seconds` is the time of making it, now or earlier.

    Outputs that were made in one pass over the frames all have the time of the whole pass. `of`
    names the output's object, and is empty for an output of all objects.
    """

    stage: str
    of: str
    fingerprint: str
    reused: bool
    seconds: float


@dataclass(frozen=True)
class Output:
    """A finished stage output: its fingerprint and its folder."""

    fingerprint: str
    folder: Path


@dataclass(frozen=True)
class Opened:
    """An output's folder: `finished`, or to be made now."""

    folder: Path
    finished: bool


class StageStore:
    """Makes each stage output once and returns its folder.

    `events` lists what this run has reused and made, in order, for the manifest.
    """

    def __init__(self, root: Path) -> None:
        self.root = root.absolute()
        self.events: list[StageEvent] = []

    def get_or_make(
        self,
        stage: str,
        fingerprint: str,
        make: Callable[[Path], None],
        description: Mapping[str, Any],
        of: str = "",
    ) -> Path:
        """The folder of a stage's output, made by `make` unless it is there already.

        `make` is called with a folder to write into; for the rest see `open`. Raises what `make`
        and `open` raise.
        """
        with self.open(stage, fingerprint, description, of) as opened:
            if not opened.finished:
                make(opened.folder)
        return self.root / stage / fingerprint

    @contextmanager
    def open(
        self, stage: str, fingerprint: str, description: Mapping[str, Any], of: str = ""
    ) -> Iterator[Opened]:
        """A stage's output: finished, or a folder to make it in.

        What is made gets its final name when the block ends, so nobody sees a partial output. After
        an error or an interruption it stays as `<fingerprint>.partial`, and the next run that makes
        the same output continues in that folder. Runs that ask for the same output at the same
        time wait for the first of them.

        `description` (settings, upstream) is stored with the output, in `stage.json`; `of` names
        the object in log and events. Raises what the block raises, with a note that names the
        folder, and DataError if a folder of that name was not written by a store.
        """
        folder = self.root / stage / fingerprint
        if self._reuse(folder, of):
            yield Opened(folder, True)
            return
        folder.parent.mkdir(parents=True, exist_ok=True)
        with self._only_one(folder):
            if self._reuse(folder, of):
                yield Opened(folder, True)
            else:
                with self._making(folder, description, of) as partial:
                    yield Opened(partial, False)

    def holds(self, stage: str, fingerprint: str) -> bool:
        """Whether an output is finished."""
        return (self.root / stage / fingerprint / RECORD).is_file()

    def take(self, stage: str, fingerprint: str, of: str, *, reused: bool) -> Path:
        """The folder of a finished output: `reused`, or else made by a worker of this run."""
        folder = self.root / stage / fingerprint
        self._note(folder, of, reused=reused, seconds=_seconds(folder))
        return folder

    def _reuse(self, folder: Path, of: str) -> bool:
        if not folder.exists():
            return False
        if not (folder / RECORD).is_file():
            raise DataError(f"{folder} is no finished output: it has no {RECORD}. Remove it.")
        self._note(folder, of, reused=True, seconds=_seconds(folder))
        return True

    @contextmanager
    def _making(self, folder: Path, description: Mapping[str, Any], of: str) -> Iterator[Path]:
        partial = folder.with_name(folder.name + ".partial")
        record = {
            "stage": folder.parent.name,
            "fingerprint": folder.name,
            **plain(description, "description"),
            "versions": library_versions(),
        }
        begun = time.perf_counter()
        try:
            partial.mkdir(exist_ok=True)
            yield partial
            seconds = time.perf_counter() - begun
            made_at = datetime.now(UTC).isoformat(timespec="seconds")
            record |= {"seconds": round(seconds, 3), "made_at": made_at}
            write_json(partial / RECORD, record)
            _flush(partial)
            partial.rename(folder)
        except BaseException as error:
            error.add_note(f"while making {folder.parent.name} in {partial}")
            raise
        self._note(folder, of, reused=False, seconds=seconds)

    def _note(self, folder: Path, of: str, *, reused: bool, seconds: float) -> None:
        event = StageEvent(folder.parent.name, of, folder.name, reused, seconds)
        self.events.append(event)
        logging.getLogger(__name__).info(
            "%-6s %s %s (%.1f s%s)",
            "reused" if reused else "made",
            f"{event.stage} of {of}" if of else event.stage,
            event.fingerprint,
            seconds,
            " saved" if reused else "",
        )

    @contextmanager
    def _only_one(self, folder: Path) -> Iterator[None]:
        lock = FileLock(folder.with_name(folder.name + ".lock"))
        try:
            lock.acquire(timeout=0)
        except Timeout:
            logging.getLogger(__name__).info(
                "waiting for another run that makes %s %s", folder.parent.name, folder.name
            )
            lock.acquire()
        try:
            yield
        finally:
            lock.release()


def _seconds(folder: Path) -> float:
    """How long it took to make a finished output."""
    return float(read_json(folder / RECORD)["seconds"])


def _flush(folder: Path) -> None:
    """Write everything in a folder to the disk itself, before the folder is renamed."""
    for path in (*folder.rglob("*"), folder):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
