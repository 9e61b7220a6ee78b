"""Some of the windows that the classifier is trained on, made as in training."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int, UInt8

from hlp.config.build import evenly
from hlp.data.dataset import Dataset
from hlp.method.stage_settings import ClassifierStage
from hlp.models.classifier import class_probabilities
from hlp.models.network import Network
from hlp.patches.holistic import Windows, center_depths
from hlp.patches.window_images import WindowImages
from hlp.records import Frame
from hlp.runs.diagnosis import FrameNotes
from hlp.stages.training import TrainingStages
from hlp.thread_team import ThreadTeam

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


_BACKGROUND = "background"


class WindowClasses:
    """Counts the classes of the windows at targets, by name; objects as rows, class in each.

    A window is cut by the rule of all windows (paper, Eq. 1), where the target is seen nearest to
    its centroid. A target of which nothing can be seen has none.
    """

    def __init__(self, training: TrainingStages) -> None:
        self._training = training
        models = training.models
        self._names = [_BACKGROUND, *(models[i].name for i in training.classes)]
        self._counts: dict[str, dict[str, int]] = {}

    @cached_property
    def _network(self) -> Network:
        return self._training.load_classifier()

    def count(self, frame: Frame, notes: FrameNotes) -> None:
        """Classify the windows at a frame's targets."""
        settings = self._training.settings
        team = ThreadTeam(settings.machine.threads)
        images = WindowImages(frame.rgb, frame.depth, settings.patches.holistic, team)
        focal = float(frame.camera_matrix[0, 0] + frame.camera_matrix[1, 1]) / 2
        for (target, _), middle in zip(notes.targets, notes.middles, strict=True):
            if middle is None:
                continue
            model = self._training.models[target.object_id]
            center = np.array([middle])
            depth = center_depths(frame.depth, center)
            sides = focal * model.holistic_size / depth
            window = Windows(center.astype(np.float64), depth, sides)
            cut = images.cut(window, model.holistic_size)
            said = self._names[int(class_probabilities(self._network, cut)[0].argmax())]
            row = self._counts.setdefault(model.name, {})
            row[said] = row.get(said, 0) + 1

    def summary(self) -> dict[str, dict[str, int]]:
        """The counts, in the order of the classes; objects that are no targets are left out."""
        rows = {true: self._counts[true] for true in self._names if true in self._counts}
        return {
            true: {said: row[said] for said in self._names if said in row}
            for true, row in rows.items()
        }
