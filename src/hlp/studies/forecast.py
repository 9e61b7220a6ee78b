"""What a sweep over data sets takes, said before it and after each run: hours, and room on disk."""

import logging
import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from hlp.errors import HlpError
from hlp.files import MANIFEST
from hlp.method.find.trace import STAGES
from hlp.reporting.table import Table
from hlp.stages.manifest import StageEvent, named_outputs, read_manifest

Extent = tuple[str, int, int, int]
"""A data set's folder, its objects, its images, and how often an object is looked for in one."""
_DEMO = np.array([[58.0, 0.26], [96e6, 41e3]])
"""Seconds, and bytes in `work`, of an object that is learnt and of a search for one in an image.

These are the demo's on two cores, for data sets and a machine of which nothing is measured yet.
"""
_HEADER = ["data set", "objects", "images", "searches", "learning", "finding", "disk"]


def say_forecast(extents: Sequence[Extent], folder: Path, work: Path) -> None:
    """Log what the runs of a sweep's folder that are not finished take, and warn of a full disk."""
    finished = dict[str, list[StageEvent]]()
    for path in folder.glob(f"*/{MANIFEST}") if extents else ():
        with suppress(HlpError):  # its run says what is wrong
            finished[str(read_manifest(path)["config"]["data"].get("root"))] = named_outputs(path)
    left = [extent for extent in extents if extent[0] not in finished]
    done = [extent for extent in extents if extent[0] in finished]
    if not left:
        return
    costs = _measured(done, [event for own in done for event in finished[own[0]]], work)
    rows, needed, counts = list[list[str]](), 0.0, np.array([own[1:] for own in left])
    names = [*(Path(root).name for root, *_ in left), "all"]
    for name, own in zip(names, [*counts, counts.sum(axis=0)], strict=True):
        (learning, finding), sizes = costs * own[[0, 2]]
        needed = sizes.sum() / 1e9
        hours = _hours(learning), _hours(finding)
        rows.append([name, *(f"{count:,}" for count in own), *hours, f"{needed:.1f} GB"])
    logger = logging.getLogger(__name__)
    logger.info(
        "What is left, in hours and minutes, %s: %.3g s to learn an object,\n%.3g s to look for "
        "one in an image. What is in %s already takes no time.\n\n%s\n",
        f"as in {len(done)} finished" if done else "as the demo on two cores",
        *(*costs[0], work, Table(_HEADER, rows).text()),
    )
    disk = next(path for path in (work.absolute(), *work.absolute().parents) if path.is_dir())
    free = shutil.disk_usage(disk).free / 1e9
    if free < needed:
        said = "%s has %.1f GB free, about %.1f are needed: free some, or choose another disk with "
        said += "work=FOLDER; after a full disk, the same command continues"
        logger.warning(said, disk, free, needed)


def _measured(done: Sequence[Extent], outputs: Sequence[StageEvent], work: Path) -> np.ndarray:
    """As `_DEMO`, of data sets that are done and of what was made for them, if there are any."""
    if not done:
        return _DEMO
    totals = np.zeros((2, 2))
    for (stage, name), seconds in {(o.stage, o.fingerprint): o.seconds for o in outputs}.items():
        size = sum(path.lstat().st_size for path in (work / stage / name).rglob("*"))
        # Each of the stages that find has the time of all of them.
        totals[:, int(stage in STAGES)] += 0 if stage in STAGES[:-1] else seconds, size
    counts = np.array([own[1:] for own in done]).sum(axis=0)
    return np.asarray(totals / np.maximum(1, counts[[0, 2]]))


def _hours(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{minutes // 60}:{minutes % 60:02d}"
