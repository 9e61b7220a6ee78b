"""Fits the score's weights of objects in general: priors in hlp/refinement/score_model.py.

    python benchmarks/score_prior.py --scenes 30 learnt/board learnt/cup learnt/mustard

Every object of the learnt folders (`Detector.learn`) is searched in rendered scenes. Printed are
the weights of each object by itself, those for all with colours and those for all without.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from hlp.method.find.estimator import PoseEstimator
from hlp.method.learn.learnt_folder import LearntFolder
from hlp.method.learn.score_calibration import search_scenes
from hlp.method.settings import FindSettings
from hlp.refinement.score_model import ScoreModel, fit_score_model, prior_of

_SEED = 1  # not that of learning
_FREE = ScoreModel(bias=100.0, cost=1000.0, shape=100.0)  # hardly any prior
_COLORLESS_FREE = replace(_FREE, edge=1000.0, hidden=100.0)


def main() -> None:
    """Search, fit, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=30, help="for each object")
    parser.add_argument("folders", type=Path, nargs="+", help="folders of learnt objects")
    given = parser.parse_args()
    everything: dict[bool, list] = {True: [], False: []}
    for folder in given.folders:
        learnt = LearntFolder(folder)
        estimator = PoseEstimator(learnt, FindSettings.of(replace(learnt.settings, seed=_SEED)))
        for object_id, model in learnt.models.items():
            answers = list(
                search_scenes(estimator, object_id, (), given.scenes, learnt.settings.rendering)
            )
            everything[model.mesh.colored] += answers
            _print(f"{folder.name} {model.name}", answers, model.mesh.colored)
    for colored, answers in everything.items():
        if answers:
            _print("with colours" if colored else "without colours", answers, colored)


def _print(name: str, answers: list, colored: bool) -> None:
    fits = [fit for fit, _ in answers]
    right = np.array([each for _, each in answers], dtype=bool)
    spread = _FREE if colored else _COLORLESS_FREE
    found = fit_score_model(fits, right, prior_of(colored), spread)
    print(f"{name:24s} {len(fits):4d} answers, {right.mean():.2f} right: {found}", flush=True)


if __name__ == "__main__":
    main()
