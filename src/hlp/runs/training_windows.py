"""Some of the windows that the classifier is trained on, made as in training."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int, UInt8

from hlp.config.build import evenly
from hlp.data.dataset import Dataset
from hlp.method.stage_settings import ClassifierStage
from hlp.records import Frame
from hlp.stages.training import TrainingStages

# In place of the settings' pools, which take half a minute.
_WINDOWS, _BACKGROUNDS, _SCENES, _FRAMES = 40, 60, 2, 2


@dataclass(frozen=True)
class _FewBackgrounds:
    """The data set's backgrounds, with a few of its frames."""

    dataset: Dataset

    def photograph_crops(
        self, count: int, size: int, rng: np.random.Generator
    ) -> UInt8[np.ndarray, "n s s 3"]:
        return self.dataset.photograph_crops(count, size, rng)

    def load_background_frames(self) -> list[Frame]:
        source = self.dataset.background_frames
        return [] if source is None else [source.load(key) for key in evenly(source.keys, _FRAMES)]

    def load_encoder_frames(self) -> list[Frame]:
        return self.dataset.load_encoder_frames()


def sample_windows(
    training: TrainingStages,
) -> tuple[Float[np.ndarray, "n c p p"], Int[np.ndarray, "n"]]:
    """Windows in [-1, 1] as the network takes them, and the class of each (0: background).

    They are composed by the code that composes the training's batches, from smaller pools.
    """
    from hlp.method.learn.classifier_training import training_windows  # takes seconds to import

    stage = ClassifierStage.of(training.settings)
    pool = stage.pool
    small = replace(
        pool,
        per_object=min(pool.per_object, _WINDOWS),
        backgrounds=min(pool.backgrounds, _BACKGROUNDS),
        distractor_scenes=min(pool.distractor_scenes, _SCENES),
    )
    few = _FewBackgrounds(training.dataset)
    data = training_windows(training.models, training.load_views, few, replace(stage, pool=small))
    images, labels = data.compose(data.pool, np.random.default_rng(stage.seed))
    return images.numpy(), labels.numpy()
