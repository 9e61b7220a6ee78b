"""Memory and time of detection under load: many frames, many processes, much that is learnt.

    python benchmarks/load.py learn learnt/
    python benchmarks/load.py frames learnt/ --frames 10000
    python benchmarks/load.py predict learnt/ --frames 10000
    python benchmarks/load.py processes learnt/ --processes 8 --frames 4
    python benchmarks/load.py size learnt/ --entries 1000000 --objects 200

`learn` learns the demo's can in half a minute, by settings that are fast and find little; any other
folder of learnt objects will do. `frames` finds the learnt objects in frame after frame by the
Python API, and `predict` by one call of `hlp predict`; `processes` runs several `hlp predict` at
once, and compares their poses; `size` loads a codebook of that many entries, and that many copies
of a learnt object. Frames are the demo's. Ends with 1 where memory or time grow by more than 5 %,
or poses differ.
"""

import argparse
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from itertools import cycle, islice
from pathlib import Path

import cv2
import numpy as np
import trimesh

from hlp import Detector
from hlp.codebook.entries import load_codebook, save_codebook
from hlp.commands.composing import compose_config
from hlp.config.build import build_settings
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.method.learn.learnt_folder import LearntFolder, write_record
from hlp.method.learn.model_files import read_model, write_model
from hlp.records import MILLIMETRE, MILLIMETRES_PER_METRE, Codebook, Frame
from hlp.runs.manifest import poses_digest

SMALL = (
    *("encoder=pca", "codebook=inverted_lists", "classifier.epochs=3", "classifier.min_batches=0"),
    *("rendering.viewpoints=80", "rendering.in_plane_steps=5", "rendering.size_px=64"),
    *("patches.pool.per_object=300", "patches.pool.backgrounds=300"),
    *("patches.pool.distractor_scenes=2", "patches.pairs.per_object=300", "voting.hypotheses=8"),
    *("refinement.particles=6", "refinement.iterations=4", "refinement.verification.candidates=2"),
)
_FIRST = 100  # frames until memory is measured
_GROWN = 1.05  # memory and time at the end, at most, times those at the beginning
_MEGABYTE = 1024.0  # kB
_QUERIES = 1000
_LAST_BYTES = 20_000  # of a file of answers, to find the last one


def main() -> int:
    """Measure what was asked for, print, and say whether it is within the limits."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("learn", "frames", "predict", "processes", "size"))
    parser.add_argument("learnt", type=Path, help="folder of learnt objects (hlp learn)")
    parser.add_argument("--frames", type=int, default=2000, help="in each process")
    parser.add_argument("--processes", type=int, default=8)
    parser.add_argument("--entries", type=int, default=1_000_000, help="of a codebook")
    parser.add_argument("--objects", type=int, default=200, help="copies of a learnt object")
    parser.add_argument("--threads", type=int, default=1, help="of each process")
    given = parser.parse_args()
    if given.what == "learn":
        return learn_the_can(given.learnt, given.threads)
    if given.what == "frames":
        return many_frames(given.learnt, given.frames, given.threads)
    if given.what == "predict":
        return one_long_call(given.learnt, given.frames, given.threads)
    if given.what == "processes":
        return many_processes(given.learnt, given.processes, given.frames, given.threads)
    with tempfile.TemporaryDirectory() as folder:
        large_codebook(given.learnt, Path(folder), given.entries)
        many_objects(given.learnt, Path(folder), given.objects)
    return 0


def learn_the_can(learnt: Path, threads: int) -> int:
    """Learn one object of the demo into a new folder."""
    settings = build_settings(compose_config("output=out", *SMALL, f"machine.threads={threads}"))
    can = next(model for model in demo_objects().values() if model.name == "can")
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "can.ply"
        shown = trimesh.Trimesh(
            can.mesh.vertices / MILLIMETRE, can.mesh.faces, vertex_colors=can.mesh.colors
        )
        shown.export(mesh)
        Detector.learn({"can": mesh}, learnt, settings=settings.method)
    return 0


def many_frames(learnt: Path, count: int, threads: int) -> int:
    """Detect in `count` frames; 0 if memory and time at the end are those at the beginning."""
    detector, frames = Detector.load(learnt, threads=threads), demo_frames(12)
    detector.warm_up()
    seconds: list[float] = []
    early = resident_mb()
    for number, frame in enumerate(islice(cycle(frames), count), start=1):
        begun = time.process_time()
        detector.detect(frame.rgb, frame.depth, frame.camera_matrix, max_instances=1)
        seconds.append(time.process_time() - begun)
        if number == min(_FIRST, count):
            early = resident_mb()
    part = max(len(frames), count // 10 // len(frames) * len(frames))
    first, last = (float(np.mean(each)) for each in (seconds[part : 2 * part], seconds[-part:]))
    return _verdict(count, (early, resident_mb()), (first, last))


def one_long_call(learnt: Path, count: int, threads: int) -> int:
    """Watch one `hlp predict` of `count` frames; 0 if memory and time do not grow."""
    seen: list[tuple[int, float, float]] = []  # frames answered, CPU time (s), memory (MB)
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        camera = write_frames(root, demo_frames(12), count)
        output = root / "out"
        command = predict_command(learnt, root, camera, threads)
        process = subprocess.Popen(  # noqa: S603 - HLP itself
            [*command, f"output={output}"], stdout=subprocess.DEVNULL
        )
        while process.poll() is None:
            time.sleep(0.5)
            answered = frames_answered(output / "poses.jsonl")
            if answered and process.poll() is None:
                seen.append((answered, cpu_seconds(process.pid), resident_mb(process.pid)))
    if process.returncode or len(seen) < 20:
        print(f"{len(seen)} looks at it, exit code {process.returncode}")
        return 1
    frames, seconds, memory = np.array(seen).T
    early, late = (np.interp(each, frames, memory) for each in (_FIRST, frames[-1]))
    times = [np.interp(part * frames[-1], frames, seconds) for part in (0.1, 0.2, 0.9, 1.0)]
    first, last = ((times[i + 1] - times[i]) / (0.1 * frames[-1]) for i in (0, 2))
    return _verdict(int(frames[-1]), (float(early), float(late)), (float(first), float(last)))


def _verdict(count: int, memory: tuple[float, float], seconds: tuple[float, float]) -> int:
    """Print memory (MB) and CPU time a frame (s), early and late; 0 if both are about the same."""
    (early, late), (first, last) = memory, seconds
    print(f"frame {min(_FIRST, count)}: {early:.0f} MB")
    print(f"frame {count}: {late:.0f} MB ({late / early - 1:+.1%})")
    print(f"CPU time a frame: {first * 1000:.1f} ms early, {last * 1000:.1f} ms at the end")
    return int(late > _GROWN * early or last > _GROWN * first)


def many_processes(learnt: Path, processes: int, count: int, threads: int) -> int:
    """Run `hlp predict` several times at once; 0 if all end well and with the same poses."""
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        camera = write_frames(root, demo_frames(count), count)
        command = predict_command(learnt, root, camera, threads)
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
    """Load that many copies of a learnt object, each with its model and codebook."""
    source = LearntFolder(learnt)
    name, object_id = next(iter(source.record.objects.items()))
    model, codebook = read_model(source.object_folder(object_id)), source.load_codebook(object_id)
    objects = {f"{name}-{number}": number for number in range(1, count + 1)}
    for copy, number in objects.items():
        place = folder / "many" / "objects" / copy
        write_model(place, dataclasses.replace(model, object_id=number, name=copy))
        save_codebook(place, dataclasses.replace(codebook, object_id=number))
    record = dataclasses.replace(source.record, objects=objects, classes=(), files={})
    write_record(folder / "many", record)
    before, begun = resident_mb(), time.perf_counter()
    many = LearntFolder(folder / "many")
    models = many.models
    loaded = [many.load_codebook(each) for each in models]
    seconds, memory = time.perf_counter() - begun, resident_mb() - before
    entries = sum(len(each.features) for each in loaded)
    print(f"{len(models)} objects, {entries} entries: {memory:.0f} MB, loaded in {seconds:.1f} s")


def demo_frames(count: int) -> Sequence[Frame]:
    """Frames of the demo, decoded; small ones, for what may grow does not depend on their size."""
    scenes = SyntheticScenes(SyntheticSettings(scenes=count, width=160, height=120))
    return [scenes.load(key) for key in scenes.keys]


def write_frames(folder: Path, frames: Sequence[Frame], count: int) -> Path:
    """Write `count` frames as images, these in turn, and the file of their camera (returned)."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir()
    for number in range(count):
        files = [folder / name / f"{number:06d}.png" for name in ("rgb", "depth")]
        if number < len(frames):
            frame = frames[number]
            millimetres = np.rint(frame.depth * MILLIMETRES_PER_METRE).astype(np.uint16)
            for file, image in zip(files, (frame.rgb[..., ::-1], millimetres), strict=True):
                cv2.imwrite(str(file), image)
        else:
            for file in files:
                file.hardlink_to(file.with_name(f"{number % len(frames):06d}.png"))
    camera = folder / "camera.json"
    camera.write_text(json.dumps({"cam_K": frames[0].camera_matrix.ravel().tolist()}))
    return camera


def predict_command(learnt: Path, folder: Path, camera: Path, threads: int) -> list[str]:
    """`hlp predict` of a folder's frames: an answer for each object, however low its score."""
    return [
        *(sys.executable, "-c", "from hlp.cli import main; main()", "predict"),
        *(f"learnt={learnt.absolute()}", f"rgb={folder / 'rgb'}", f"depth={folder / 'depth'}"),
        *(f"intrinsics={camera}", f"threads={threads}", "min_score=0", "max_instances=1"),
    ]


def frames_answered(answers: Path) -> int:
    """Number of the frame that the last answer is about, counted from 1; 0 where there is none."""
    if not answers.is_file():
        return 0
    with answers.open("rb") as file:
        file.seek(max(0, answers.stat().st_size - _LAST_BYTES))
        lines = file.read().decode().splitlines()[1:-1]
    return int(json.loads(lines[-1])["im_id"]) + 1 if lines else 0


def cpu_seconds(process: int) -> float:
    """CPU time of another process so far."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(process: int | str = "self") -> float:
    """Memory (MB) that a process holds."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("VmRSS")) / _MEGABYTE


if __name__ == "__main__":
    sys.exit(main())
