"""HLP beside OpenCV's LINEMOD, on the same frames and in the same process.

    pip install --target build/linemod --no-deps opencv-contrib-python-headless
    PYTHONPATH=build/linemod python benchmarks/linemod.py learnt/cat ../shared/data/lm --object-id 6

`cv2.linemod` is part of OpenCV's extra modules, which is why it is installed beside the
environment, for this call alone. Its templates are rendered from the learnt object's mesh, as in
Hinterstoisser et al. (ACCV 2012): views of the upper hemisphere, turned in the image, at several
distances. Each match becomes a coarse pose: the template's rotation, and the distance that fits
the observed depth under the template best. The best ones are refined and chosen by HLP's stage 3,
so that the two differ in how coarse poses are found. The object is known to be in each frame.
Printed are recalls (ADD below a tenth of the diameter) and the medians of the times.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from hlp import Detector
from hlp.data.bop import BopSettings
from hlp.evaluation.errors import add
from hlp.geometry import back_project, rigid
from hlp.records import Frame, Hypotheses, ObjectModel
from hlp.rendering.rasterizer import FRONTAL_LIGHT, render_rgbd
from hlp.rendering.views import hemisphere, view_rotations

_VIEWPOINTS, _TURNS = 90, np.radians(np.arange(-45, 46, 10))
_DISTANCES = np.arange(0.65, 1.2, 0.1)  # m, as in the paper
_THRESHOLD = 60.0  # percent of a template's features
_MARGIN = 8  # px around a template
_PIXELS = 200  # of a template, whose depth is compared
_HYPOTHESES = 60

Find = Callable[[Frame], tuple[np.ndarray | None, float]]
"""The pose of the object in a frame, if any, and the seconds that it took."""


@dataclass(frozen=True)
class Template:
    """A view: rotation, the centroid's depth and its place in the template, pixels and depths."""

    rotation: np.ndarray
    distance: float
    centroid: np.ndarray
    pixels: np.ndarray
    depths: np.ndarray


class Linemod:
    """`cv2.linemod` with templates of one object."""

    def __init__(self, model: ObjectModel, camera_matrix: np.ndarray) -> None:
        self.detector = cv2.linemod.getDefaultLINEMOD()
        self.camera_matrix = camera_matrix
        self.templates: list[Template] = []
        rotations = view_rotations(hemisphere(_VIEWPOINTS, 0), _TURNS)
        for distance in _DISTANCES:
            for rotation in rotations:
                self._add(model, rotation, float(distance))

    def _add(self, model: ObjectModel, rotation: np.ndarray, distance: float) -> None:
        camera = self.camera_matrix
        side = int(1.1 * model.diameter / distance * camera[0, 0]) + 2 * _MARGIN
        own = camera.copy()
        own[:2, 2] = (side - 1) / 2
        pose = rigid(rotation, np.array([0.0, 0.0, distance]) - rotation @ model.centroid)
        rgb, depth = render_rgbd(model.mesh, pose, own, (side, side), FRONTAL_LIGHT)
        mask = (depth > 0.0).astype(np.uint8) * 255
        images = [np.ascontiguousarray(rgb[..., ::-1]), np.rint(depth * 1000).astype(np.uint16)]
        number, box = self.detector.addTemplate(images, "object", mask)
        if number < 0:  # too few features
            return
        assert number == len(self.templates)
        y, x = np.nonzero(depth)
        chosen = np.linspace(0, len(x) - 1, _PIXELS).astype(int)
        pixels = np.column_stack([x, y])[chosen] - box[:2]
        centroid = own[:2, 2] - box[:2]
        depths = depth[y, x][chosen].astype(np.float64)
        self.templates.append(Template(rotation, distance, centroid, pixels, depths))

    def hypotheses(self, frame: Frame, model: ObjectModel) -> Hypotheses:
        """Coarse poses of the best matches."""
        bgr, depth = frame.rgb[..., ::-1], np.rint(frame.depth * 1000).astype(np.uint16)
        matches, _ = self.detector.match([np.ascontiguousarray(bgr), depth], _THRESHOLD)
        poses, support = [], []
        for match in matches[:_HYPOTHESES]:
            poses.append(self._pose(match, frame, model))
            support.append(match.similarity)
        return Hypotheses(np.array(poses).reshape(-1, 4, 4), np.array(support))

    def _pose(self, match: "cv2.linemod.Match", frame: Frame, model: ObjectModel) -> np.ndarray:
        template = self.templates[match.template_id]
        place = np.array([match.x, match.y])
        height, width = frame.depth.shape
        x, y = np.clip(template.pixels + place, 0, [width - 1, height - 1]).T
        seen = frame.depth[y, x]
        there = seen > 0
        apart = np.median(seen[there] - template.depths[there]) if there.any() else 0.0
        z = template.distance + apart
        centre = back_project(template.centroid + place, np.array(z), frame.camera_matrix)
        return rigid(template.rotation, centre - template.rotation @ model.centroid)


def main() -> None:
    """Find the object by both in every frame."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("learnt", type=Path, help="folder with one learnt object")
    parser.add_argument("data", type=Path, help="data set in BOP's layout that shows it")
    parser.add_argument("--object-id", type=int, required=True, help="its id there")
    parser.add_argument("--frames", type=int, default=40)
    given = parser.parse_args()
    detector = Detector.load(given.learnt, threads=1)
    cv2.setNumThreads(1)
    detector.warm_up()
    (model,) = detector.models.values()
    frames = frames_of(given.data, given.object_id, given.frames)
    begun = time.perf_counter()
    linemod = Linemod(model, frames[0].camera_matrix)
    print(f"{len(linemod.templates)} templates made in {time.perf_counter() - begun:.0f} s")
    estimator = detector._estimator
    matching: list[float] = []

    def by_linemod(frame: Frame) -> tuple[np.ndarray | None, float]:
        context = estimator.prepare(frame)
        begun = time.perf_counter()
        hypotheses = linemod.hypotheses(frame, model)
        matching.append(time.perf_counter() - begun)
        found = estimator.refine(context, model.object_id, hypotheses)
        pose = None if found is None else found.refined[found.instances[0]].pose_cam_obj
        return pose, time.perf_counter() - begun

    def by_hlp(frame: Frame) -> tuple[np.ndarray | None, float]:
        begun = time.perf_counter()
        found = detector.detect(frame.rgb, frame.depth, frame.camera_matrix, None, 1, 0.0)
        spent = time.perf_counter() - begun
        return (found[0].pose_cam_obj if found else None), spent

    times = {"HLP": report("HLP", by_hlp, frames, model, given.object_id)}
    times["LINEMOD"] = report("LINEMOD", by_linemod, frames, model, given.object_id)
    print(f"LINEMOD's matching alone: {1000 * np.median(matching):.0f} ms")
    print(f"LINEMOD takes {times['LINEMOD'] / times['HLP']:.1f} times as long")


def frames_of(root: Path, object_id: int, most: int) -> list[Frame]:
    """Frames that show the object, spread evenly."""
    source = BopSettings(root=str(root)).build().frames
    loaded = (source.load(key) for key in source.keys)
    showing = [each for each in loaded if any(t.object_id == object_id for t in each.targets)]
    count = min(most, len(showing))
    return [showing[i * len(showing) // count] for i in range(count)]


def report(name: str, find: Find, frames: list[Frame], model: ObjectModel, object_id: int) -> float:
    """Print how many poses are right; the median time of a frame (s)."""
    find(frames[0])  # the first call loads and compiles
    right, spent = 0, []
    for frame in frames:
        pose, seconds = find(frame)
        spent.append(seconds)
        (true,) = (t.pose_cam_obj for t in frame.targets if t.object_id == object_id)
        if pose is not None:
            right += add(pose, true, model.mesh.vertices) < 0.1 * model.diameter
    print(f"{name}: {right} of {len(frames)} right, {1000 * np.median(spent):.0f} ms", flush=True)
    return float(np.median(spent))


if __name__ == "__main__":
    main()
