"""The typed settings of a run, which the configuration is turned into."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Protocol

from annotated_types import Ge, Le

from hlp.data.dataset import DATASETS, DataSettings
from hlp.evaluation import EvaluationSettings
from hlp.method.settings import MethodSettings
from hlp.reporting.mlflow.tracking import MlflowSettings
from hlp.settings import Count, Doc, Named, Registry, Settings, SettingsError, WholeNumber
from hlp.stages.executor_settings import EXECUTORS, ExecutorSettings
from hlp.stages.warm_start import WarmStartSettings

if TYPE_CHECKING:
    from hlp.config.build import Run


class TaskSettings(Named, Protocol):
    """Settings of a task: what is done with a configuration."""

    def run(self, run: Run, output: Path) -> None:
        """Do the task; results go into `output`."""


TASKS: Registry[TaskSettings] = Registry("task", "hlp.studies")
"""Alternatives of config group `task`."""


@dataclass(frozen=True)
class StepSettings(Settings):
    """What a step of experiment=ladder changes, for its table; see conf/ladder.yaml."""

    change: Annotated[str, Doc("the change, in words")] = ""
    before: Annotated[str | None, Doc("the step that it is compared with; null: none")] = None


@dataclass(frozen=True, kw_only=True)
class RunSettings(MethodSettings):
    """The whole configuration: the method's groups, and those of a run around it.

    A group of alternatives names its registry; the others have one class.
    """

    name: Annotated[str, Doc("name of the experiment")]
    work: Annotated[
        str, Doc("folder shared by all runs: finished stages and MLflow's database")
    ] = "work"
    output: Annotated[str, Doc("this run's folder")]
    data_folder: Annotated[
        str | None, Doc("folder with several data sets, for experiment=recordings")
    ] = None
    frames: Annotated[
        int | None, Ge(1), Doc("use only this many frames, spread evenly; null: all")
    ] = None
    on_bad_frame: Annotated[
        Literal["report", "fail"],
        Doc(
            "a frame whose files are broken or missing: report: its targets count as wrong, the "
            "others are scored; fail: it ends the run"
        ),
    ] = "report"
    panels: Annotated[
        WholeNumber, Le(100_000), Doc("number of frames that are drawn; 0: no pictures")
    ] = 6
    timing_frames: Annotated[
        Count, Doc("frames processed again to measure times when results were already on disk")
    ] = 20
    warm_start: WarmStartSettings = field(default_factory=WarmStartSettings)
    step: StepSettings = field(default_factory=StepSettings)
    data: Annotated[DataSettings, DATASETS]
    evaluation: EvaluationSettings
    reporting: MlflowSettings
    executor: Annotated[ExecutorSettings, EXECUTORS]
    task: Annotated[TaskSettings, TASKS]

    def __post_init__(self) -> None:
        """Raise SettingsError for a folder without a name, and alternatives that do not fit."""
        super().__post_init__()
        for key in ("name", "work", "output"):
            if not getattr(self, key).strip():
                raise SettingsError(key, "is empty: name one")

    @property
    def method(self) -> MethodSettings:
        """The settings of the method alone, without data set, evaluation and reporting."""
        own = {one.name: getattr(self, one.name) for one in fields(MethodSettings)}
        return MethodSettings(**own)
