"""What a sweep over data sets takes, said before it and after each run: hours, and room on disk."""

import logging
import shutil
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hlp.arrays import spread
from hlp.data.bop import BopSettings
from hlp.errors import HlpError
from hlp.files import EXAMPLE, MANIFEST, shipped_folder
from hlp.method.detector import Detector
from hlp.method.find.trace import STAGES
from hlp.reporting.table import Table
from hlp.stages.manifest import StageEvent, named_outputs, read_manifest

_LEARNING = 58.0
"""Seconds to learn one of the demo's objects on two cores, where nothing has been learnt yet."""
_SIZES = np.array([96e6, 41e3])
"""Bytes in `work` of one of the demo's objects, and of a search for one in an image."""
_IMAGES = 3  # searched before the first run
_HEADER = ["data set", "objects", "images", "searches", "learning", "finding", "disk"]


class Extent(NamedTuple):
    """A data set: its folder, objects, images, searches for one in an image; seconds of one."""

    root: str
    counts: tuple[int, int, int]
    seconds: float


def extent_of(settings: BopSettings, most: int | None) -> Extent:
    """What a run will search, in at most so many images, after searches in three of them.

    An object that HLP ships is looked for, which they do not show: that takes longest. Raises as
    `BopSettings.extent`.
    """
    frames, counts = settings.extent(most)
    say = logging.getLogger(__name__).info
    say("searching %d images of %s, to tell how long it will take", _IMAGES, settings.root)
    detector, times = Detector.load(shipped_folder(EXAMPLE) / "learnt"), list[float]()
    keys = spread(frames.keys, _IMAGES)
    for key in (*keys[:1], *keys):  # the first search, which compiles kernels, does not count
        with suppress(HlpError):  # the image's run says what is wrong
            frame = frames.load(key)
            begun = time.perf_counter()
            detector.detect(frame.rgb, frame.depth, frame.camera_matrix, max_instances=1)
            times.append(time.perf_counter() - begun)
    return Extent(settings.root, counts, float(np.median(times[1:] or [0.0])))


def say_forecast(extents: Sequence[Extent], folder: Path, work: Path) -> None:
    """Log what the runs of a sweep's folder that are not finished take, and warn of a full disk."""
    finished = dict[str, list[StageEvent]]()
    for path in folder.glob(f"*/{MANIFEST}") if extents else ():
        with suppress(HlpError):  # its run says what is wrong
            finished[str(read_manifest(path)["config"]["data"].get("root"))] = named_outputs(path)
    extents = [Extent(*extent) for extent in extents]  # lists, as they come from sweep.json
    left = [extent for extent in extents if extent.root not in finished]
    done = [extent for extent in extents if extent.root in finished]
    if not left:
        return
    learning, slower, sizes = _measured(done, [e for own in done for e in finished[own.root]], work)
    counts = np.array([own.counts for own in left])
    table = np.column_stack([
        counts,
        learning * counts[:, 0],
        slower * counts[:, 2] * [own.seconds for own in left],
        counts[:, [0, 2]] @ sizes / 1e9,
    ])  # fmt: skip
    names, rows = [*(Path(own.root).name for own in left), "all"], list[list[str]]()
    for name, own in zip(names, [*table, needed := table.sum(axis=0)], strict=True):
        hours = _hours(own[3]), _hours(own[4])
        rows.append([name, *(f"{count:,.0f}" for count in own[:3]), *hours, f"{own[5]:.1f} GB"])
    logger = logging.getLogger(__name__)
    logger.info(
        "What is left, in hours and minutes: %.3g s to learn an object, as %s; searches as timed "
        "in\nthree images of each set%s. What is in %s already takes no time.\n\n%s\n",
        learning,
        f"in {len(done)} finished" if done else "the demo's on two cores",
        f", × {slower:.2g} as in what is finished" if done else ", for an object that is not there",
        work,
        Table(_HEADER, rows).text(),
    )
    disk = next(path for path in (work.absolute(), *work.absolute().parents) if path.is_dir())
    free = shutil.disk_usage(disk).free / 1e9
    if free < needed[5]:
        said = "%s has %.1f GB free, about %.1f are needed: free some, or choose another disk with "
        said += "work=FOLDER; after a full disk, the same command continues"
        logger.warning(said, disk, free, needed[5])


def _measured(
    done: Sequence[Extent], outputs: Sequence[StageEvent], work: Path
) -> tuple[float, float, np.ndarray]:
    """Seconds to learn an object, how many times as long searches took, and as `_SIZES`."""
    if not done:
        return _LEARNING, 1.0, _SIZES
    totals = np.zeros((2, 2))
    for (stage, name), seconds in {(o.stage, o.fingerprint): o.seconds for o in outputs}.items():
        size = sum(path.lstat().st_size for path in (work / stage / name).rglob("*"))
        # Each of the stages that find has the time of all of them.
        totals[:, int(stage in STAGES)] += 0 if stage in STAGES[:-1] else seconds, size
    counts = np.maximum(1, np.array([own.counts for own in done]).sum(axis=0)[[0, 2]])
    foreseen = sum(own.counts[2] * own.seconds for own in done)
    (learning, finding), sizes = totals
    return learning / counts[0], finding / foreseen if foreseen else 1.0, sizes / counts


def _hours(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{minutes // 60}:{minutes % 60:02d}"
