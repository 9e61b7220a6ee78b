"""Outputs of stages on disk, each in a folder named after its fingerprint.

<root>/<stage>/<fingerprint>/          finished: never changed again
<root>/<stage>/<fingerprint>.partial/  begun, not finished
<root>/<stage>/<fingerprint>.damaged/  finished once, then changed by something else; not used
<root>/<stage>/<fingerprint>.lock      held by the run that is making it
<root>/.in-use                         held by all runs, so that nothing is removed meanwhile
"""

import logging
import os
import shutil
import sys
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from io import FileIO
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from hlp.errors import DataError, InputError, MissingFileError
from hlp.files import read_json, remove_unfinished, write_json
from hlp.fingerprints import find_damaged, folder_checksums, seal_is_whole, sealed
from hlp.folders import lock_file, own_files
from hlp.schemas import by_name, record
from hlp.settings import stored_as
from hlp.stages import STEPS
from hlp.stages.manifest import MakingTime, StageEvent, library_versions, named_outputs, plain

RECORD, IN_USE = "stage.json", ".in-use"
PARTIAL, DAMAGED, LOCK = ".partial", ".damaged", ".lock"
_logger = logging.getLogger(__name__)


_RECORD = record(stage=str, fingerprint=str, seconds=MakingTime, files=by_name(str))
"""stage.json of a finished output; `files` are checksums by path, `seconds` that it took."""


@dataclass(frozen=True)
class Output:
    """A finished stage output: its fingerprint and its folder."""

    fingerprint: str
    folder: Path


class StageStore:
    """Makes each stage output once and returns its folder.

    An output carries checksums of its files, in `stage.json`. They are verified when a store first
    opens the output. A damaged one, or a folder that no store has written, is set aside and made
    again. `events` lists what this run has reused and made, in order, for the manifest.
    """

    def __init__(self, root: Path) -> None:
        self.root = root.absolute()
        self.events: list[StageEvent] = []
        self._verified: dict[Path, Mapping[str, Any]] = {}  # records of outputs
        self._announced: set[str] = set()
        self._in_use: FileIO | None = None

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
        with self.open(stage, fingerprint, description, of) as (partial, finished):
            if not finished:
                make(partial)
        return self.root / stage / fingerprint

    @contextmanager
    def open(
        self, stage: str, fingerprint: str, description: Mapping[str, Any], of: str = ""
    ) -> Iterator[tuple[Path, bool]]:
        """The folder of a stage's output, and whether it is finished; else it is made in there.

        What is made gets its final name when the block ends, so nobody sees a partial output. After
        an error or an interruption it stays as `<fingerprint>.partial`, and the next run that makes
        the same output continues in that folder. Runs that ask for the same output at the same
        time wait for the first of them.

        `description` (settings, upstream) is stored with the output, in `stage.json`; `of` names
        the object in log and events. Raises what the block raises, with a note of the folder.
        """
        folder = self.root / stage / fingerprint
        if self.problem(stage, fingerprint):
            folder.parent.mkdir(parents=True, exist_ok=True)
            self._hold_in_use()
            with _only_one(folder):
                if problem := self.problem(stage, fingerprint):  # by now
                    if os.path.lexists(folder):
                        _put_aside(folder, problem)
                    with self._making(folder, description) as partial:
                        yield partial, False
                    self._note(folder, of, reused=False)
                    return
        self._note(folder, of, reused=True)
        yield folder, True

    def problem(self, stage: str, fingerprint: str) -> str:
        """Why an output cannot be used; empty if it is finished and undamaged."""
        try:
            self.read_record(stage, fingerprint)
        except (DataError, FileNotFoundError) as error:  # another run may set it aside meanwhile
            return str(error)
        return ""

    def named_by(self, manifest: Path, stage: str, of: str = "") -> Output:
        """The finished output of a stage (of an object) that an earlier run's manifest names.

        Raises MissingFileError if it is not in this store, and DataError if it is damaged.
        """
        named = {(event.stage, event.of): event.fingerprint for event in named_outputs(manifest)}
        name = named.get((stage, of), "")
        folder = self.root / stage / name
        if not name or not folder.is_dir():
            raise MissingFileError(
                f"{self.root} has no {f'{stage} of {of}' if of else stage} that {manifest} names: "
                "name the folder of that run with work=FOLDER, or repeat it (hlp run manifest=…)"
            )
        try:
            self.read_record(stage, name)
        except DataError as error:
            error.add_note(f"repeat the run of {manifest}, which makes it again")
            raise
        return Output(name, folder)

    def take(self, stage: str, fingerprint: str, of: str, *, reused: bool) -> Path:
        """The folder of a finished output: `reused`, or else made by a worker of this run.

        Raises DataError if it is missing or damaged.
        """
        self.read_record(stage, fingerprint)
        folder = self.root / stage / fingerprint
        self._note(folder, of, reused=reused)
        return folder

    def read_record(self, stage: str, fingerprint: str) -> Mapping[str, Any]:
        """`stage.json` of a finished output. Raises DataError if it is missing or damaged."""
        folder = self.root / stage / fingerprint
        self._hold_in_use()
        if folder not in self._verified:
            self._verified[folder] = _verify(folder)
        return self._verified[folder]

    @contextmanager
    def _making(self, folder: Path, description: Mapping[str, Any]) -> Iterator[Path]:
        partial, stage = _cleared(folder.with_name(folder.name + PARTIAL)), folder.parent.name
        made = {"stage": stage, "fingerprint": folder.name, **plain(description)}
        made["versions"] = library_versions()
        if stage in STEPS and stage not in self._announced:  # what a stage is for is said once
            self._announced.add(stage)
            number = [*STEPS].index(stage) + 1
            _logger.info("step %d of %d, %s: %s", number, len(STEPS), stage, STEPS[stage])
        begun = time.perf_counter()
        try:
            partial.mkdir(exist_ok=True)
            yield partial
            made["seconds"] = round(time.perf_counter() - begun, 3)
            made["made_at"] = datetime.now(UTC).isoformat(timespec="seconds")
            remove_unfinished(partial)
            made["files"] = folder_checksums(partial, leaving_out=(RECORD,))
            write_json(partial / RECORD, sealed(made))
            _flush(partial)
            partial.rename(folder)
        except BaseException as error:
            error.add_note(f"while making {stage} in {partial}")
            raise
        self._verified[folder] = made

    def _note(self, folder: Path, of: str, *, reused: bool) -> None:
        """Add an event for an output that was verified or made."""
        stage, seconds = folder.parent.name, float(self._verified[folder]["seconds"])
        self.events.append(StageEvent(stage, of, folder.name, reused, seconds))
        done, saved = ("reused", " saved") if reused else ("made", "")
        what = f"{stage} of {of}" if of else stage
        _logger.info("%-6s %s %s (%.1f s%s)", done, what, folder.name, seconds, saved)

    def _hold_in_use(self) -> None:
        """Share the lock on the store until this object goes; waits while it is being cleaned.

        The system frees the lock of a dead process. Without effect on Windows, and in a store that
        this process may only read.
        """
        if self._in_use is not None or sys.platform == "win32":
            return
        import fcntl

        # No folder yet, a read-only one, a file system without locks; or a link, which cleaning
        # refuses, too.
        with suppress(OSError, InputError):
            self._in_use = lock_file(self.root / IN_USE)
            weakref.finalize(self, self._in_use.close)
            fcntl.flock(self._in_use, fcntl.LOCK_SH)


@contextmanager
def _only_one(folder: Path) -> Iterator[None]:
    """Hold the lock of an output, once no other run holds it any more."""
    path = folder.with_name(folder.name + LOCK)
    if path.is_symlink() or path.is_dir():
        _put_aside(path, f"{path} is no lock")
    lock = FileLock(path)
    try:
        held = lock.acquire(timeout=0)
    except Timeout:
        _logger.info("waiting for another run that makes %s %s", folder.parent.name, folder.name)
        held = lock.acquire()
    with held:
        yield


def _put_aside(path: Path, problem: str) -> None:
    """Rename what is no part of the store, whatever it is; an earlier one is removed."""
    aside = path.with_suffix(DAMAGED)
    _logger.warning("%s: kept as %s, made again", problem, aside.name)
    if aside.is_dir() and not aside.is_symlink():
        shutil.rmtree(aside)
    else:
        aside.unlink(missing_ok=True)
    path.rename(aside)


def _cleared(partial: Path) -> Path:
    """The place of an output that is being made: a folder of the store's own, or nothing."""
    if partial.is_symlink() or (partial.exists() and not partial.is_dir()):
        _put_aside(partial, f"{partial} is not a folder of its own")
    try:
        own_files(partial)
    except DataError as error:
        _put_aside(partial, str(error))
    return partial


def _verify(folder: Path) -> Mapping[str, Any]:
    """The record of an output whose files all are as they were when it was finished.

    Raises DataError that says what is wrong.
    """
    if not folder.is_dir():
        raise DataError(f"{folder} is not a folder")
    path = folder / RECORD
    if not path.is_file():
        raise DataError(f"{folder} is not a finished output: it has no {RECORD}")
    own_files(folder)
    content = read_json(path)
    if not seal_is_whole(content):
        raise DataError(f"{path} is damaged, or from an earlier version of HLP")
    stated = stored_as(_RECORD, content, str(path))
    if (stated.stage, stated.fingerprint) != (folder.parent.name, folder.name):
        raise DataError(f"{folder} is an output of another name")
    for name in find_damaged(folder, stated.files):
        raise DataError(f"{folder / name} is missing or damaged")
    return dict(content)


def _flush(folder: Path) -> None:
    """Write everything in a folder to the disk itself, before the folder is renamed."""
    for path in (*folder.rglob("*"), folder):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
