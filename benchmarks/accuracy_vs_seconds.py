"""Accuracy against CPU seconds: HLP at several speeds beside OpenCV's LINEMOD and PPF.

    pip install --target build/contrib --no-deps opencv-contrib-python-headless
    export PYTHONPATH=build/contrib OMP_NUM_THREADS=1
    python benchmarks/accuracy_vs_seconds.py ../shared/data --work work

Everything runs on the same frames, in one process with one thread; how many instances of which
objects are in a frame is known. `cv2.linemod` and `cv2.ppf_match_3d` belong to OpenCV's extra
modules, which is why they are installed beside the environment. What HLP has not learnt in `--work`
it learns first. Further arguments are overrides of the configuration.

- HLP: the defaults, faster searches by the same learnt objects, and `method=many_objects`.
- LINEMOD's coarse poses are refined and chosen by HLP's stage 3, so that the two differ in how
  coarse poses are found.
- PPF with OpenCV's ICP, most votes first; and once more with HLP's stage 3 in place of ICP.

`accuracy_seconds.csv` has a row for each recording and method, ADD(-S) below a tenth of the
diameter being right; a target is an object in an image. The figure has published methods, with
their own measure, data and hardware, in a panel of their own.
"""

import argparse
import csv
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure
from opencv_methods import Linemod, Poses, Ppf, Views, scene_of

from hlp.commands.composing import compose_config
from hlp.config.build import build_run, build_settings
from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.method.find.estimator import FrameContext
from hlp.records import Frame, Hypotheses, PoseEstimate
from hlp.reporting.bop_table import PUBLISHED
from hlp.reporting.figures import save_figure
from hlp.runs.runner import stages_of
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore

SPEEDS = {
    "HLP": (),
    "HLP, 10 particles": ("refinement.particles=10",),
    "HLP, 5 particles": ("refinement.particles=5", "refinement.second_search=null"),
    "HLP, 60 ms": ("refinement.budget_ms=60",),
    "HLP, 20 ms": ("refinement.budget_ms=20",),
}
COLUMNS = ("recording", "method", "frames", "targets", "instances", "recall", "cpu_s", "wall_s")
_UNKNOWN = 0.5  # s: where the figure has methods whose time nobody states
Find = Callable[[Frame], dict[int, Poses]]
"""The poses of each object that is in a frame."""


def searched(stages: DetectionStages) -> Find:
    """HLP."""

    def find(frame: Frame) -> dict[int, Poses]:
        found = stages.search(frame).items()
        return {i: each.refined.chosen_poses if each.refined else [] for i, each in found}

    return find


def others(stages: DetectionStages, frames: Sequence[Frame], viewpoints: int) -> dict[str, Find]:
    """OpenCV's methods."""
    models, count = stages.dataset.models, stages.dataset.instances_to_find
    views = Views.of(stages.settings.rendering, frames, viewpoints)
    ids = stages.dataset.target_ids
    linemod = {i: Linemod(models[i], frames[0].camera_matrix, views) for i in ids}
    ppf = {i: Ppf(models[i]) for i in ids}
    made = {models[i].name: len(each.templates) for i, each in linemod.items()}
    print(f"LINEMOD's templates: {made}", flush=True)

    def refined(context: FrameContext, object_id: int, coarse: Hypotheses, most: int) -> Poses:
        found = stages.estimator.refine(context, object_id, coarse, most)
        return found.chosen_poses if found else []

    def by_linemod(frame: Frame) -> dict[int, Poses]:
        seen, counts = stages.estimator.prepare(frame), count(frame)
        return {i: refined(seen, i, linemod[i].hypotheses(frame, n), n) for i, n in counts.items()}

    def by_ppf(frame: Frame) -> dict[int, Poses]:
        scene = scene_of(frame, views)
        return {i: ppf[i].poses(scene, n) for i, n in count(frame).items()}

    def by_ppf_and_hlp(frame: Frame) -> dict[int, Poses]:
        seen, scene = stages.estimator.prepare(frame), scene_of(frame, views)
        counts = count(frame).items()
        return {i: refined(seen, i, ppf[i].hypotheses(scene, n), n) for i, n in counts}

    return {"LINEMOD": by_linemod, "PPF, ICP": by_ppf, "PPF, HLP's stage 3": by_ppf_and_hlp}


def measured(find: Find, frames: Sequence[Frame], models: Any, policy: Any) -> tuple[Any, ...]:
    """Frames, targets, instances, recall, CPU and wall seconds of a target."""
    find(frames[0])  # loads and compiles
    estimates: list[PoseEstimate] = []
    cpu = wall = 0.0
    for frame in frames:
        begun = time.process_time(), time.perf_counter()
        found = find(frame)
        cpu, wall = cpu + time.process_time() - begun[0], wall + time.perf_counter() - begun[1]
        of = frame.scene_id, frame.frame_id
        estimates += [PoseEstimate(*of, i, pose, 1.0) for i in found for pose in found[i]]
    scores = score_targets(map(FrameTruth.of, frames), models, estimates, policy)
    targets = sum(len({target.object_id for target in frame.targets}) for frame in frames)
    recall = float(np.mean([score.add_correct for score in scores]))
    spent = [f"{seconds / targets:.4f}" for seconds in (cpu, wall)]
    return len(frames), targets, len(scores), f"{recall:.4f}", *spent


def rows_of(recording: str, given: argparse.Namespace) -> list[tuple[Any, ...]]:
    """A row for each method."""
    always = (f"data={recording}", f"data_folder={given.data_folder}", f"work={given.work}")
    always = (*always, "output=out", "machine.threads=1", *given.overrides)
    run = build_run(compose_config(*always))
    store = StageStore(given.work)
    stages, many = (
        stages_of(build_run(compose_config(*always, *other)), store)
        for other in ((), ("method=many_objects",))
    )
    frames = [stages.load(key) for key in run.keys]
    finds: dict[str, Find] = {}
    for name, overrides in SPEEDS.items():
        settings = build_settings(compose_config(*always, *overrides)).method
        own = DetectionStages(run.dataset, settings, stages.training, run.keys)
        finds[name] = searched(own)
    finds["HLP, many_objects"] = searched(many)
    for each in (stages, many):
        each.training.make_for(run.dataset.target_ids)
    finds |= others(stages, frames, given.views)
    rows = []
    for name, find in finds.items():
        if given.leave_out and name.startswith(given.leave_out):
            continue
        numbers = measured(find, frames, run.dataset.models, run.settings.evaluation)
        rows.append((recording, name, *numbers))
        print(*rows[-1], flush=True)
    return rows


def draw(rows: Sequence[Sequence[Any]], path: Path) -> None:
    """A panel for each recording, and one for published methods, whose axes are others."""
    panels = defaultdict(list)
    for recording, name, *_, recall, cpu, _ in rows:
        panels[recording].append((name, float(cpu), float(recall)))
    figure = Figure(figsize=(3.4 * (len(panels) + 1), 4.6), layout="constrained")
    *own, other = figure.subplots(1, len(panels) + 1)
    seconds_of_all = [seconds for points in panels.values() for _, seconds, _ in points]
    ends = min(seconds_of_all) / 2, 2 * max(seconds_of_all)
    for axis, (recording, points) in zip(own, panels.items(), strict=True):
        for number, (name, seconds, recall) in enumerate(points, 1):
            hlp = name.startswith("HLP")
            color, marker = ("#0072b2", "o") if hlp else ("#d55e00", "s")
            axis.plot(seconds, recall, marker, color=color, label=f"{number} {name}")
            axis.annotate(str(number), (seconds, recall), (4, 3), textcoords="offset points")
        axis.set(title=recording, xlabel="CPU s a target, one thread", xscale="log", xlim=ends)
    own[0].set_ylabel("ADD(-S) recall")
    shown = own[0].get_legend_handles_labels()
    figure.legend(*shown, loc="outside lower center", ncols=len(panels) + 2)
    for name, recall, stated, hardware in PUBLISHED:
        at = _UNKNOWN if stated is None else stated
        words = f"{name}, {hardware}" if stated else f"{name}, {hardware}, time not stated"
        other.plot(at, recall, "D", color="#777777")
        other.annotate(
            words, (at, recall), (0, 6 if stated else -13), textcoords="offset points", fontsize=7
        )
    other.set(title="published: other data, machines", xscale="log", xlim=(0.4, 3000))
    other.set(xlabel="s an image", ylabel="BOP's AR, seven core sets")
    for axis in (*own, other):
        axis.set_ylim(0, 1.02)
        axis.grid(alpha=0.3)
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter("")
    save_figure(figure, path)


def main() -> None:
    """Measure on every recording, and write a table and a figure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data_folder", type=Path, help="holds the recordings' folders")
    parser.add_argument("--work", type=Path, required=True, help="as work= of hlp run")
    parser.add_argument("--recordings", nargs="+", default=["board", "parts", "boxes"])
    parser.add_argument("--views", type=int, default=90, help="viewpoints of LINEMOD's templates")
    parser.add_argument("--leave-out", help="methods that begin so, as PPF: the slowest")
    parser.add_argument("--output", type=Path, default=Path("accuracy"))
    parser.add_argument("overrides", nargs="*", help="of the configuration, as frames=40")
    given = parser.parse_intermixed_args()
    cv2.setNumThreads(1)
    given.output.mkdir(parents=True, exist_ok=True)
    rows = [row for recording in given.recordings for row in rows_of(recording, given)]
    with (given.output / "accuracy_seconds.csv").open("w", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([COLUMNS, *rows])
    draw(rows, given.output / "accuracy_seconds")


if __name__ == "__main__":
    main()
