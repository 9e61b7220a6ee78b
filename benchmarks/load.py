"""Memory and time of detection under load: many frames, many processes, much that is learnt.

    python benchmarks/load.py frames learnt/ --frames 10000
    python benchmarks/load.py processes learnt/ --processes 8 --frames 4
    python benchmarks/load.py size learnt/ --entries 1000000 --objects 200

`frames` finds the learnt objects in frame after frame in one process; `processes` runs several
`hlp predict` at once, and compares their poses; `size` loads a codebook of that many entries, and
that many copies of a learnt object. Frames are the demo's. Ends with 1 where memory or time grow by
more than 5 %, or poses differ.
"""

import argparse
import dataclasses
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from itertools import cycle, islice
from pathlib import Path

import cv2
import numpy as np

from hlp import Detector
from hlp.codebook.entries import load_codebook, save_codebook
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.method.learnt_folder import LearntFolder, read_model, write_model, write_record
from hlp.records import MILLIMETRES_PER_METRE, Codebook, Frame
from hlp.runs.manifest import poses_digest

_FIRST = 100  # frames until memory is measured
_GROWN = 1.05  # memory and time at the end, at most, times those at the beginning
_MEGABYTE = 1024.0  # kB
_QUERIES = 1000


def main() -> int:
    """Measure what was asked for, print, and say whether it is within the limits."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("frames", "processes", "size"))
    parser.add_argument("learnt", type=Path, help="folder of learnt objects (hlp learn)")
    parser.add_argument("--frames", type=int, default=2000, help="in each process")
    parser.add_argument("--processes", type=int, default=8)
    parser.add_argument("--entries", type=int, default=1_000_000, help="of a codebook")
    parser.add_argument("--objects", type=int, default=200, help="copies of a learnt object")
    parser.add_argument("--threads", type=int, default=1, help="of each process")
    given = parser.parse_args()
    if given.what == "frames":
        return many_frames(given.learnt, given.frames, given.threads)
    if given.what == "processes":
        return many_processes(given.learnt, given.processes, given.frames, given.threads)
    with tempfile.TemporaryDirectory() as folder:
        large_codebook(given.learnt, Path(folder), given.entries)
        many_objects(given.learnt, Path(folder), given.objects)
    return 0


def many_frames(learnt: Path, count: int, threads: int) -> int:
    """Detect in `count` frames; 0 if memory and time at the end are those at the beginning."""
    detector, frames = Detector.load(learnt, threads=threads), demo_frames(12)
    detector.warm_up()
    seconds: list[float] = []
    early = resident_mb()
    for number, frame in enumerate(islice(cycle(frames), count), start=1):
        begun = time.process_time()
        detector.detect(frame.rgb, frame.depth, frame.camera_matrix)
        seconds.append(time.process_time() - begun)
        if number == min(_FIRST, count):
            early = resident_mb()
            print(f"frame {number}: {early:.0f} MB", flush=True)
    late, part = resident_mb(), max(len(frames), count // 10 // len(frames) * len(frames))
    first, last = (float(np.mean(each)) for each in (seconds[part : 2 * part], seconds[-part:]))
    print(f"frame {count}: {late:.0f} MB ({late / early - 1:+.1%})")
    print(f"CPU time a frame: {first * 1000:.1f} ms early, {last * 1000:.1f} ms at the end")
    return int(late > _GROWN * early or last > _GROWN * first)


def many_processes(learnt: Path, processes: int, count: int, threads: int) -> int:
    """Run `hlp predict` several times at once; 0 if all end well and with the same poses."""
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        camera = write_frames(root, demo_frames(count))
        command = [
            *(sys.executable, "-c", "from hlp.cli import main; main()", "predict"),
            *(f"learnt={learnt.absolute()}", f"rgb={root / 'rgb'}", f"depth={root / 'depth'}"),
            *(f"intrinsics={camera}", f"threads={threads}", "min_score=0"),
        ]
        begun = time.perf_counter()
        started = [
            subprocess.Popen(  # noqa: S603 - HLP itself
                [*command, f"output={root / str(number)}"], stdout=subprocess.DEVNULL
            )
            for number in range(processes)
        ]
        codes = [each.wait() for each in started]
        seconds = time.perf_counter() - begun
        written = [root / str(number) / "poses.csv" for number in range(processes)]
        digests = {poses_digest(path) for path in written if path.is_file()}
        rows = len(written[0].read_text().splitlines()) - 1 if written[0].is_file() else 0
    print(f"{processes} processes, {count} frames each, {seconds:.1f} s; exit codes {codes}")
    print(f"{rows} poses in each, {len(digests)} different results")
    return int(any(codes) or len(digests) != 1)


def large_codebook(learnt: Path, folder: Path, entries: int) -> None:
    """Write and load a codebook of that many random entries, and search in it."""
    source = LearntFolder(learnt)
    small = source.load_codebook(min(source.record.objects.values()))
    rng = np.random.default_rng(0)
    chosen = rng.integers(len(small.features), size=entries)
    noise = rng.normal(scale=0.01, size=(entries, small.features.shape[1]))
    features = (small.features[chosen] + noise).astype(np.float32)
    large = Codebook(
        1, features, small.rotations_cam_obj[chosen], small.points_obj[chosen], small.feature_scale
    )
    save_codebook(folder, large)
    queries = features[:: max(1, entries // _QUERIES)].copy()
    del features, large, noise
    before, begun = resident_mb(), time.perf_counter()
    loaded = load_codebook(folder)
    read = time.perf_counter() - begun
    search = source.settings.codebook
    begun = time.perf_counter()
    search.prepare(loaded.features, 0, folder)
    prepared = time.perf_counter() - begun
    begun = time.perf_counter()
    neighbours = search.build(loaded.features, 0, 1, folder)
    built = time.perf_counter() - begun
    begun = time.perf_counter()
    neighbours.search(queries)
    found = (time.perf_counter() - begun) / len(queries)
    size = sum(path.stat().st_size for path in folder.iterdir()) / 1e6
    print(
        f"{entries} entries of {queries.shape[1]} numbers ({search.name}): {size:.0f} MB on disk, "
        f"{resident_mb() - before:.0f} MB in memory; read in {read:.1f} s, search prepared in "
        f"{prepared:.1f} s and built in {built:.1f} s, {found * 1e6:.0f} µs a query"
    )


def many_objects(learnt: Path, folder: Path, count: int) -> None:
    """Load that many copies of a learnt object, each with its model, codebook and score."""
    source = LearntFolder(learnt)
    name, object_id = next(iter(source.record.objects.items()))
    model, codebook = read_model(source.object_folder(object_id)), source.load_codebook(object_id)
    score = (source.object_folder(object_id) / "score.json").read_bytes()
    objects = {f"{name}-{number}": number for number in range(1, count + 1)}
    for copy, number in objects.items():
        place = folder / "many" / "objects" / copy
        write_model(place, dataclasses.replace(model, object_id=number, name=copy))
        save_codebook(place, dataclasses.replace(codebook, object_id=number))
        (place / "score.json").write_bytes(score)
    record = dataclasses.replace(source.record, objects=objects, classes=(), files={})
    write_record(folder / "many", record)
    before, begun = resident_mb(), time.perf_counter()
    many = LearntFolder(folder / "many")
    models = many.models
    loaded = [(many.load_codebook(each), many.load_score_model(each)) for each in models]
    seconds, memory = time.perf_counter() - begun, resident_mb() - before
    entries = sum(len(each.features) for each, _ in loaded)
    print(f"{len(models)} objects, {entries} entries: {memory:.0f} MB, loaded in {seconds:.1f} s")


def demo_frames(count: int) -> Sequence[Frame]:
    """Frames of the demo, of 320x240 pixels, decoded."""
    scenes = SyntheticScenes(SyntheticSettings(scenes=count, width=320, height=240))
    return [scenes.load(key) for key in scenes.keys]


def write_frames(folder: Path, frames: Sequence[Frame]) -> Path:
    """Write frames as images, and the file of their camera, which is returned."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir()
    for number, frame in enumerate(frames):
        millimetres = np.rint(frame.depth * MILLIMETRES_PER_METRE).astype(np.uint16)
        cv2.imwrite(str(folder / "rgb" / f"{number:04d}.png"), frame.rgb[..., ::-1])
        cv2.imwrite(str(folder / "depth" / f"{number:04d}.png"), millimetres)
    camera = folder / "camera.json"
    camera.write_text(json.dumps({"cam_K": frames[0].camera_matrix.ravel().tolist()}))
    return camera


def resident_mb() -> float:
    """Memory (MB) that this process holds."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("VmRSS")) / _MEGABYTE


if __name__ == "__main__":
    sys.exit(main())
