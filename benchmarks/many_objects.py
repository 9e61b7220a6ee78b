"""Time and memory of a frame when many objects are known and asked for.

    python benchmarks/many_objects.py learn learnt/fifteen --objects 15 --method many_objects
    python benchmarks/many_objects.py find learnt/fifteen --asked 1 7 15 --frames 6

`learn` learns that many random shapes that stand upright (960 views of each) and prints the seconds
that an object takes. `find` renders frames of seven of them on a table, and asks for as many
objects as each of `--asked` says: those that are there first, then others. It prints the time of a
frame beside that of the first number, how many of the objects that are there are right (ADD-S below
a tenth of the diameter), false alarms, and the memory of the process.
"""

import argparse
import resource
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from hlp import Detection, Detector
from hlp.commands.composing import compose_config
from hlp.config.build import build_settings
from hlp.data.synthetic.layout import Item, light_from_above, look_at, place_targets
from hlp.data.synthetic.scenes import LINEMOD_CAMERA
from hlp.data.synthetic.surfaces import draw_surroundings, random_surroundings
from hlp.evaluation.errors import add_s
from hlp.geometry import rigid
from hlp.objects.distractors import random_shape
from hlp.objects.shapes import merge, moved_by
from hlp.records import MILLIMETRE, Frame, Mesh, ObjectModel, Target
from hlp.rendering.rasterizer import render_scene
from hlp.rendering.sensor import Kinect, noisy_depth, noisy_rgb

SETTINGS = ("patches.pool.per_object=500", "patches.pairs.per_object=500")
THERE = 7  # objects on the table
_SHAPE = (480, 640)
_RIGHT = 0.1  # of the diameter


def main() -> None:
    """Learn, or find and measure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("learn", "find"))
    parser.add_argument("learnt", type=Path, help="folder of learnt objects, written by `learn`")
    parser.add_argument("--objects", type=int, default=15, help="to learn")
    parser.add_argument("--method", default="hlp", help="to learn by: a file of conf/method")
    parser.add_argument("--asked", type=int, nargs="+", default=[1, 7, 15])
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--threads", type=int, default=2)
    given = parser.parse_args()
    if given.what == "learn":
        learn(given.learnt, given.objects, given.method, given.threads)
    else:
        find(given.learnt, given.asked, given.frames, given.threads)


def learn(folder: Path, count: int, method: str, threads: int) -> None:
    """Learn `count` random objects into a new folder."""
    wanted = (f"machine.threads={threads}", f"trainer.torch_threads={threads}", *SETTINGS)
    settings = build_settings(compose_config("output=out", f"method={method}", *wanted)).method
    begun, cpu = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as name:
        meshes = {}
        for number in range(count):
            mesh = random_object(np.random.default_rng([0, number]))
            path = Path(name) / f"object{number:03d}.ply"
            shown = trimesh.Trimesh(
                mesh.vertices / MILLIMETRE, mesh.faces, vertex_colors=mesh.colors, process=False
            )
            shown.export(path)
            meshes[path.stem] = path
        Detector.learn(meshes, folder, settings=settings, mesh_scale=MILLIMETRE)
    spent, cpu = time.perf_counter() - begun, time.process_time() - cpu
    size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) / 1e6
    print(
        f"{count} objects: {spent:.0f} s, {spent / count:.1f} s an object "
        f"(CPU {cpu / count:.1f} s), {size / count:.1f} MB an object on disk, "
        f"{peak_mib():.0f} MiB of memory at most"
    )


def random_object(rng: np.random.Generator) -> Mesh:
    """Two or three random shapes stuck together: hardly any two are alike."""
    parts = []
    for _ in range(int(rng.integers(2, 4))):
        turn = Rotation.random(random_state=rng).as_matrix()
        parts.append(moved_by(random_shape(rng), rigid(turn, rng.normal(0.0, 0.02, 3))))
    return merge(*parts)


def find(folder: Path, numbers: Sequence[int], count: int, threads: int) -> None:
    """Find as many objects as each of the `numbers` says in `count` frames, and print a table."""
    detector = Detector.load(folder, threads=threads)
    detector.warm_up()
    models = list(detector.models.values())
    frames = [render_frame(models, number) for number in range(count)]
    print(f"{len(models)} objects known; {count} frames of {THERE} objects")
    first = None
    for asked in numbers:
        found = [find_in(detector, frame, asked) for frame in frames]
        wall, cpu = (float(np.median([each[part] for each in found])) for part in (0, 1))
        right, alarms, targets = (sum(int(each[part]) for each in found) for part in (2, 3, 4))
        first = wall if first is None else first
        print(
            f"asked for {asked}: {wall:.0f} ms a frame (CPU {cpu:.0f}), {wall / first:.1f} times "
            f"the first; right {right} of {targets}, false alarms {alarms}"
        )
    print(f"{peak_mib():.0f} MiB of memory at most")


def find_in(detector: Detector, frame: Frame, asked: int) -> tuple[float, float, int, int, int]:
    """Milliseconds, those of CPU time, right poses, false alarms and targets in one frame."""
    names = {model.object_id: name for name, model in detector.models.items()}
    there = [target.object_id for target in frame.targets]
    wanted = [*there, *(i for i in names if i not in there)][:asked]
    begun, busy = time.perf_counter(), time.process_time()
    found = detector.detect(
        frame.rgb,
        frame.depth,
        frame.camera_matrix,
        objects=[names[i] for i in wanted],
        max_instances=1,
    )
    wall, cpu = time.perf_counter() - begun, time.process_time() - busy
    true = {names[each.object_id]: each for each in frame.targets if each.object_id in wanted}
    right = sum(is_right(each, true, detector.models) for each in found)
    alarms = sum(each.object not in true for each in found)
    return 1000 * wall, 1000 * cpu, right, alarms, len(true)


def is_right(
    found: Detection, true: Mapping[str, Target], models: Mapping[str, ObjectModel]
) -> bool:
    """Whether a detection is one of the true ones."""
    if found.object not in true:
        return False
    model = models[found.object]
    vertices = model.mesh.vertices[:: max(1, len(model.mesh.vertices) // 1000)]
    error = add_s(found.pose_cam_obj, true[found.object].pose_cam_obj, vertices)
    return error < _RIGHT * model.diameter


def render_frame(models: Sequence[ObjectModel], number: int) -> Frame:
    """A frame of some of the objects, upright on a table, by the demo's sensor."""
    rng = np.random.default_rng([1, number])
    azimuth = rng.uniform(0.0, 2 * np.pi)
    pose_cam_world = look_at(
        np.array([0.0, 0.0, 0.05]), rng.uniform(0.7, 1.0), azimuth, np.radians(45.0), 0.0
    )
    chosen = [models[i] for i in rng.permutation(len(models))[:THERE]]
    items: list[Item] = place_targets(chosen, 0.0, rng)
    light = light_from_above(pose_cam_world, rng)
    parts = [(item.mesh, pose_cam_world @ item.pose_world_obj) for item in items]
    rgb, depth, index = render_scene(parts, LINEMOD_CAMERA, _SHAPE, light)
    around = random_surroundings(azimuth, rng)
    back = draw_surroundings(around, items, pose_cam_world, LINEMOD_CAMERA, _SHAPE, light)
    empty = index < 0
    rgb[empty], depth[empty] = back[0][empty], back[1][empty]
    sensor = Kinect()
    return Frame(
        scene_id=0,
        frame_id=number,
        rgb=noisy_rgb(rgb, rng, sensor),
        depth=noisy_depth(depth, float(LINEMOD_CAMERA[0, 0]), rng, sensor),
        camera_matrix=LINEMOD_CAMERA.copy(),
        targets=tuple(
            Target(item.object_id, pose, 1.0) for item, (_, pose) in zip(items, parts, strict=True)
        ),
    )


def peak_mib() -> float:
    """The most memory (MiB) that this process has held; `hlp.studies` would load torch."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10


if __name__ == "__main__":
    main()
