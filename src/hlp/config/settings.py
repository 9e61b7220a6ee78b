"""All settings of a run, typed: what the configuration becomes before any stage runs."""

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Tag

from hlp.codebook.entries import EntrySettings
from hlp.codebook.inverted_lists import InvertedListsSettings
from hlp.codebook.neighbours import ExactSettings, KdForestSettings
from hlp.data.bop import BopSettings
from hlp.data.linemod import LinemodSettings
from hlp.data.own_frames import FilesSettings
from hlp.data.synthetic.scenes import SyntheticSettings
from hlp.evaluation.settings import EvaluationSettings
from hlp.models.autoencoder import AutoencoderSettings
from hlp.models.classifier import ClassifierSettings
from hlp.models.contrastive import ContrastiveSettings
from hlp.models.pca import PcaSettings
from hlp.patches.holistic import HolisticSettings, RegionSettings
from hlp.patches.holistic_pool import HolisticPoolSettings
from hlp.patches.local import GridSettings, LocalSettings
from hlp.patches.local_pool import PairSettings
from hlp.refinement.icp import IcpSettings
from hlp.refinement.none import NoneSettings
from hlp.refinement.pso import PsoSettings
from hlp.rendering.views import ViewsSettings
from hlp.reporting.tracking import TrackingSettings
from hlp.voting.modes import JointVotingSettings, PaperVotingSettings

# Keys that change how fast a result is made, never what it is.
MACHINE_KEYS = frozenset({"threads"})


@dataclass(frozen=True)
class PatchesSettings:
    """Config group `patches`: one record per step that cuts or chooses patches."""

    name: str
    holistic: HolisticSettings
    region: RegionSettings
    pool: HolisticPoolSettings
    local: LocalSettings
    grid: GridSettings
    pairs: PairSettings
    entries: EntrySettings


@dataclass(frozen=True)
class TrainerSettings:
    """Config group `trainer`: passed to Lightning's Trainer; `torch_threads` for all of torch."""

    name: str
    accelerator: str
    devices: int
    strategy: str
    precision: str
    torch_threads: int


@dataclass(frozen=True)
class MachineSettings:
    """Config group `machine`: `threads` of the numba kernels and of OpenCV.

    `device` computes the networks' answers.
    """

    name: str
    threads: int
    device: Literal["cpu", "cuda"]


@dataclass(frozen=True)
class SerialSettings:
    """Config group `executor`: frames one after another, in the run's own process."""

    name: str


@dataclass(frozen=True)
class PoolSettings:
    """Config group `executor`: frames in `workers` of this machine, each with `threads`.

    Workers are processes (loky) or threads of the run's process (threading).
    """

    name: str
    workers: int
    threads: int


@dataclass(frozen=True)
class ClusterSettings:
    """Config group `executor`: frames on a running dask or ray cluster at `address`.

    Each of its workers has `threads`.
    """

    name: str
    address: str
    threads: int


ExecutorSettings = SerialSettings | PoolSettings | ClusterSettings


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
class WarmStartSettings:
    """Objects added to those of an earlier run; see conf/config.yaml for what each means."""

    manifest: str | None
    epochs: int


@dataclass(frozen=True)
class RunSettings:
    """The whole configuration, one typed record per group.

    `frames` limits a run to that many frames, spread evenly (None: all); pictures are drawn of
    `panels` frames.
    """

    name: str
    seed: int
    work: str
    output: str
    frames: int | None
    panels: int
    warm_start: WarmStartSettings
    data: SyntheticSettings | BopSettings | LinemodSettings | FilesSettings
    rendering: ViewsSettings
    patches: PatchesSettings
    classifier: ClassifierSettings
    encoder: ContrastiveSettings | AutoencoderSettings | PcaSettings
    codebook: ExactSettings | KdForestSettings | InvertedListsSettings
    voting: JointVotingSettings | PaperVotingSettings
    refinement: PsoSettings | IcpSettings | NoneSettings
    evaluation: EvaluationSettings
    reporting: TrackingSettings
    trainer: TrainerSettings
    machine: MachineSettings
    executor: ExecutorSettings
    task: EvaluateSettings | OracleSettings | BasinSettings | BenchSettings | SearchSettings


def result_settings(settings: Any) -> dict[str, Any]:
    """Settings that decide a result: all but machine keys, with the record's name."""
    kept = {
        each.name: getattr(settings, each.name)
        for each in dataclasses.fields(settings)
        if each.name not in MACHINE_KEYS
    }
    return {type(settings).__name__: kept}


def with_threads(settings: Any, threads: int) -> Any:
    """The same (nested) settings with another number of threads, which decides no result."""
    changes: dict[str, Any] = {}
    for each in dataclasses.fields(settings):
        value = getattr(settings, each.name)
        if each.name in MACHINE_KEYS:
            changes[each.name] = threads
        elif dataclasses.is_dataclass(value):
            changes[each.name] = with_threads(value, threads)
    return dataclasses.replace(settings, **changes)
