"""Makes the training and detection stages of a run from its settings."""

from hlp.config.build import Run
from hlp.stages.detection import DetectionStages, OnBadFrame
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages


def stages_of(run: Run, store: StageStore, on_bad_frame: OnBadFrame = "fail") -> DetectionStages:
    """Training and detection stages over the run's frames; nothing is computed yet.

    `on_bad_frame` "report" is for those who count the targets of bad frames as wrong. Raises
    DataError for the first frame that is known to be bad, with "fail".
    """
    if on_bad_frame == "fail":
        run.require_sound_frames()
    settings = run.settings
    training = TrainingStages(run.dataset, settings.method, store, settings.warm_start)
    return DetectionStages(
        run.dataset,
        settings.method,
        training,
        store,
        run.keys,
        settings.executor,
        on_bad_frame,
        run.bad_frames,
    )
