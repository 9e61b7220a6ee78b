"""All settings of a run, typed: what the configuration becomes before any stage runs."""

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Discriminator, Tag

from hlp.data.loading import DataSettings
from hlp.evaluation.settings import EvaluationSettings
from hlp.method.settings import (
    EncoderSettings,
    MachineSettings,
    MethodSettings,
    PatchesSettings,
    RefinementSettings,
    SearchIndexSettings,
    TrainerSettings,
    VotingSettings,
)
from hlp.models.classifier import ClassifierSettings
from hlp.refinement.icp import IcpSettings
from hlp.refinement.none import NoneSettings
from hlp.refinement.pso import PsoSettings
from hlp.rendering.views import ViewsSettings
from hlp.reporting.tracking import TrackingSettings
from hlp.stages.executor_settings import ExecutorSettings
from hlp.stages.warm_start import WarmStartSettings


@dataclass(frozen=True)
class EvaluateSettings:
    """Config group `task`: learn, find and score."""

    name: str


@dataclass(frozen=True)
class OracleSettings:
    """Config group `task`: what each stage costs; keys as in conf/task/oracle.yaml."""

    name: str
    frames: int | None
    noise_deg: float
    noise_mm: float
    agree_mm: float


# Told apart by their `name`, so that a wrong key is named as one of its own refiner.
AnyRefiner = Annotated[
    Annotated[PsoSettings, Tag("pso")]
    | Annotated[IcpSettings, Tag("icp")]
    | Annotated[NoneSettings, Tag("none")],
    Discriminator(
        lambda values: values.get("name"),
        custom_error_type="refiner",
        custom_error_message="its name is none of pso, icp, none",
    ),
]


@dataclass(frozen=True)
class BasinSettings:
    """Config group `task`: what each refiner recovers from; keys as in conf/task/basin.yaml."""

    name: str
    compared: tuple[str, ...]
    frames: int | None
    rotation_deg: tuple[float, ...]
    translation_mm: tuple[float, ...]
    perturbations: int
    refiners: dict[str, AnyRefiner]

    def __post_init__(self) -> None:
        """Raise ValueError naming the key of a list that cannot be worked with."""
        for refiner in self.compared:
            if refiner not in self.refiners:
                known = ", ".join(self.refiners)
                raise ValueError(f"task.compared names '{refiner}': choose of {known}")
        for key in ("compared", "rotation_deg", "translation_mm"):
            values = getattr(self, key)
            if not values or len(set(values)) < len(values):
                raise ValueError(f"task.{key} is {list(values)}: list each once, one at least")
        for key in ("rotation_deg", "translation_mm"):
            if not all(value >= 0.0 for value in getattr(self, key)):
                raise ValueError(f"task.{key} is {list(getattr(self, key))}: from 0 upwards")


@dataclass(frozen=True)
class BenchSettings:
    """Config group `task`: what detection costs; keys as in conf/task/bench.yaml.

    `compared` holds, by name, what other paths through the same frames have otherwise, nested as
    in the whole configuration.
    """

    name: str
    frames: int | None
    same_mm: float
    same_deg: float
    compared: dict[str, dict[str, Any]]


@dataclass(frozen=True)
class SpaceSettings:
    """What a search may change: ranges and choices, nested as in the whole configuration."""

    name: str
    parameters: dict[str, Any]


@dataclass(frozen=True)
class SearchSettings:
    """Config group `task`: a search for settings; keys as in conf/task/search.yaml."""

    name: str
    trials: int
    limit_ms: float
    space: SpaceSettings


@dataclass(frozen=True)
class RunSettings:
    """The whole configuration, one typed record per group.

    `frames` limits a run to that many frames, spread evenly (None: all); pictures are drawn of
    `panels` frames; `timing_frames` are looked at again to measure the time, where results were
    found on disk.
    """

    name: str
    seed: int
    work: str
    output: str
    frames: int | None
    panels: int
    timing_frames: int
    warm_start: WarmStartSettings
    data: DataSettings
    rendering: ViewsSettings
    patches: PatchesSettings
    classifier: ClassifierSettings
    encoder: EncoderSettings
    codebook: SearchIndexSettings
    voting: VotingSettings
    refinement: RefinementSettings
    evaluation: EvaluationSettings
    reporting: TrackingSettings
    trainer: TrainerSettings
    machine: MachineSettings
    executor: ExecutorSettings
    task: EvaluateSettings | OracleSettings | BasinSettings | BenchSettings | SearchSettings

    @property
    def method(self) -> MethodSettings:
        """What the method itself is handed: its groups, without data set, scores and reports."""
        return MethodSettings(
            seed=self.seed,
            rendering=self.rendering,
            patches=self.patches,
            classifier=self.classifier,
            encoder=self.encoder,
            codebook=self.codebook,
            voting=self.voting,
            refinement=self.refinement,
            trainer=self.trainer,
            machine=self.machine,
        )
