"""Fits the score's weights to poses whose truth is known: see hlp/refinement/score_model.py.

    python benchmarks/score_weights.py data=bin data.seed=7 data.scenes=60
    python benchmarks/score_weights.py data=demo data.seed=7 data.scenes=60

The arguments are overrides of `experiment=recordings`; what is not learnt in `work` is learnt
first. Every object is searched in every frame, whether it is there or not. Printed are the weights
of each object by itself, then those for all with colours and for all without. Right poses (ADD-S
below a tenth of the diameter) have `RIGHT_SHARE` of the weight, whatever their number. What a score
is lowered by beside these weights, for few pixels, say, is no part of the fit but stays as it is.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from hlp.commands.composing import compose_config
from hlp.config.build import build_run
from hlp.evaluation.errors import add_s
from hlp.method.find.search import search_frame
from hlp.records import Frame
from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.score_model import RIGHT_SHARE, logits_of, score_inputs, score_model_of
from hlp.runs.runner import stages_of
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore

_RIGHT = 0.1  # of the diameter
_WEAK = 1e-3  # of the squared weights: none grows without limit where all is explained

Answer = tuple[PoseFit, bool]
"""How a pose fits, and whether it is right."""


def answers(stages: DetectionStages, frame: Frame, object_id: int) -> Iterator[Answer]:
    """What is found of an object in a frame, and once more than it is there."""
    model = stages.dataset.models[object_id]
    true = [target.pose_cam_obj for target in frame.targets if target.object_id == object_id]
    context = stages.estimator.prepare(frame)
    found = search_frame(context, {object_id: len(true) + 1}, by_threads=False)[object_id]
    poses = [] if found.refined is None else found.refined.chosen_poses
    for pose, fit in zip(poses, found.fits, strict=True):
        errors = [add_s(pose, each, model.mesh.vertices) for each in true]
        yield fit, min(errors, default=np.inf) < _RIGHT * model.diameter


def fit_weights(told: list[Answer], colored: bool) -> np.ndarray:
    """Bias, and the weights of `score_inputs`, of the most probable model."""
    fits, right = [fit for fit, _ in told], np.array([each for _, each in told])
    inputs = np.column_stack([np.ones(len(fits)), score_inputs(fits)])[:, : 3 if colored else 5]
    model = score_model_of(colored)
    scores = np.array([model.score(fit) for fit in fits])
    beside = logits_of(scores) - inputs @ model.weights()[: inputs.shape[1]]
    shares = np.where(right, RIGHT_SHARE / right.mean(), (1.0 - RIGHT_SHARE) / (~right).mean())

    def loss(weights: np.ndarray) -> float:
        logits = inputs @ weights + beside
        return float(
            shares @ (np.logaddexp(0.0, logits) - logits * right) + _WEAK * weights @ weights
        )

    return np.asarray(minimize(loss, np.zeros(inputs.shape[1])).x)


def main() -> None:
    """Learn, search, fit, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("overrides", nargs="*", help="of the configuration, as data=bin")
    given = parser.parse_args()
    run = build_run(compose_config("experiment=recordings", "output=out", *given.overrides))
    stages = stages_of(run, StageStore(Path(run.settings.work)))
    stages.training.make_for(run.dataset.target_ids)
    told: dict[int, list[Answer]] = {object_id: [] for object_id in run.dataset.target_ids}
    for number, key in enumerate(run.keys, 1):
        for object_id, known in told.items():
            known += answers(stages, stages.load(key), object_id)
        print(f"{number} of {len(run.keys)} frames", file=sys.stderr)
    models = run.dataset.models
    groups = [(models[i].name, [i], models[i].mesh.colored) for i in told]
    groups += [
        (f"all {words} colours", [i for i in told if models[i].mesh.colored == colored], colored)
        for words, colored in (("with", True), ("without", False))
    ]
    print(*("object", "answers", "right", "bias", "cost", "shape", "edge", "hidden"))
    for name, ids, colored in groups:
        own = [answer for object_id in ids for answer in told[object_id]]
        if 0 < (right := sum(is_right for _, is_right in own)) < len(own):
            print(name, len(own), right, *np.round(fit_weights(own, colored), 1))


if __name__ == "__main__":
    main()
