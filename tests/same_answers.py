"""Whether `hlp run` and `Detector.detect` find the same poses with the same scores."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from hlp import Detector
from hlp.commands.composing import compose_config
from hlp.commands.learn import learnt_of_run
from hlp.config.build import build_run
from hlp.method.find.search import search_frame
from hlp.method.find.trace import ObjectTrace
from hlp.refinement.pose_fit import PoseFit
from hlp.runs.manifest import MANIFEST
from hlp.runs.runner import stages_of
from hlp.stages.store import StageStore


def compare_answers(
    overrides: Iterable[str], output: Path, folder: Path, frames: int | None = None
) -> int:
    """Compare the answers to every target of a finished run's first frames; the number of poses.

    What the run has learnt is written into a folder. A run seeds the swarms of each frame by the
    frame's number, which an image that is given to a detector does not have. So the run's estimator
    is asked twice: with the number it must find what the run has found, without it what the
    detector finds. A target is known to be there, so that its score in a run is higher than the
    detector's, and that it is looked for at more places.
    """
    run = build_run(compose_config(*overrides, "output=out"))
    detection = stages_of(run, StageStore(Path(run.settings.work)))
    estimates = {(e.scene_id, e.frame_id, e.object_id): e for e in detection.estimates()}
    assert detection.reused == {"regions", "hypotheses", "poses"}
    learnt_of_run(run, output / MANIFEST, folder)
    detector, compared = Detector.load(folder), 0
    for key in run.keys[:frames]:
        frame = run.dataset.frames.load(key)
        counts = dict.fromkeys(run.dataset.instances_to_find(frame), 1)
        of_run, of_image = (
            search_frame(detection.estimator.prepare(one), counts, min_score=low, by_threads=False)
            for one, low in ((frame, None), (replace(frame, scene_id=0, frame_id=0), 0.0))
        )
        image = frame.rgb, frame.depth, frame.camera_matrix
        names = {object_id: run.dataset.models[object_id].name for object_id in counts}
        answers = detector.detect(*image, list(names.values()), max_instances=1, min_score=0.0)
        found = {answer.object: answer for answer in answers}
        for object_id, name in names.items():
            score = detection.estimator.score_model(object_id)
            estimate = estimates[frame.scene_id, frame.frame_id, object_id]
            poses, fits = _chosen(of_run[object_id])
            assert [estimate.score] == (score.scores(fits[:1], known_present=True) or [0.0])
            np.testing.assert_array_equal(poses[:1], _only(estimate.pose_cam_obj))
            poses, fits = _chosen(of_image[object_id])
            answer = found.get(name)
            np.testing.assert_array_equal(poses[:1], _only(answer and answer.pose_cam_obj))
            assert answer is None or (answer.fit, answer.score) == (fits[0], score.score(fits[0]))
            compared += len(poses)
    return compared


def _chosen(trace: ObjectTrace) -> tuple[list[np.ndarray], tuple[PoseFit, ...]]:
    return ([], ()) if trace.refined is None else (trace.refined.chosen_poses, trace.fits)


def _only(pose: np.ndarray | None) -> list[np.ndarray]:
    return [] if pose is None else [pose]
