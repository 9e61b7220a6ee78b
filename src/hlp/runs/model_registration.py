"""Learnt objects registered in MLflow as a model, with an example of what it is called with."""

from pathlib import Path

from hlp.method.detector import MOST_INSTANCES
from hlp.method.example_image import example_image
from hlp.method.learn.learnt_folder import LearntFolder
from hlp.refinement.score_model import MIN_SCORE
from hlp.reporting.model_registry import register
from hlp.reporting.model_signature import ModelInput


def register_learnt(folder: Path, model: str, uri: str) -> str:
    """Copy a folder of learnt objects into MLflow as a new version of `model`; its address.

    Raises what `register` raises, and DataError if the folder is damaged.
    """
    learnt = LearntFolder(folder)
    objects = tuple(learnt.record.objects)
    first = next(iter(learnt.models.values()))
    given = ModelInput(objects, MOST_INSTANCES, MIN_SCORE, example_image(first))
    return register(folder, model, uri, {"objects": ", ".join(objects)}, given)
