"""Makes the training and detection stages of a run from its settings."""

from hlp.config.build import Run
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages


def stages_of(run: Run, store: StageStore) -> DetectionStages:
    """Training and detection stages over the run's frames; nothing is computed yet."""
    settings = run.settings
    training = TrainingStages(run.dataset, settings.method, store, settings.warm_start)
    return DetectionStages(
        run.dataset, settings.method, training, store, run.keys, settings.executor
    )
