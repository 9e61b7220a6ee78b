"""Settings of the method: how objects are learnt and found, and what each stage reads of them."""

from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal, Self

from annotated_types import Le

from hlp.codebook.entries import EntrySettings
from hlp.codebook.inverted_lists import InvertedListsSettings
from hlp.codebook.neighbours import SEARCHES, NeighboursSettings
from hlp.models import classifier, encoder
from hlp.models.classifier import ClassifierSettings
from hlp.models.encoder import ENCODERS, EncoderSettings
from hlp.models.network_encoders import ContrastiveSettings
from hlp.patches.holistic import HolisticSettings
from hlp.patches.holistic_pool import HolisticPoolSettings
from hlp.patches.local import GridSettings, LocalSettings
from hlp.patches.local_pool import PairSettings
from hlp.patches.region import CloserLookSettings, RegionSettings
from hlp.refinement.pso import PsoSettings
from hlp.refinement.refiner import REFINERS, RefinementSettings
from hlp.refinement.score_model import MIN_SCORE
from hlp.rendering.views import ViewsSettings
from hlp.settings import Count, CountOrNone, Doc, Settings, SettingsError, Share, WholeNumber
from hlp.templates.building import TemplateSettings
from hlp.voting.modes import VOTINGS, JointVotingSettings, VotingSettings

Device = Literal["cpu", "cuda"]
Precision = Literal["32-true", "bf16-mixed", "16-mixed", "bf16-true", "16-true", "64-true"]
"""What Lightning trains in."""


@dataclass(frozen=True)
class PatchesSettings(Settings):
    """Config group `patches`: one record for each step that cuts or chooses patches."""

    name: Annotated[str, Doc("of the choice")] = "hlp"
    holistic: HolisticSettings = field(default_factory=HolisticSettings)
    region: RegionSettings = field(default_factory=RegionSettings)
    closer_look: CloserLookSettings = field(default_factory=CloserLookSettings)
    pool: HolisticPoolSettings = field(default_factory=HolisticPoolSettings)
    local: LocalSettings = field(default_factory=LocalSettings)
    grid: GridSettings = field(default_factory=GridSettings)
    pairs: PairSettings = field(default_factory=PairSettings)
    entries: EntrySettings = field(default_factory=EntrySettings)
    templates: Annotated[
        TemplateSettings | None,
        Doc("search by gradient directions where votes find nothing sure; null: none (D; P: none)"),
    ] = field(default_factory=TemplateSettings)


@dataclass(frozen=True)
class TrainerSettings(Settings):
    """Config group `trainer`: arguments of Lightning's Trainer, and torch's threads."""

    name: Annotated[str, Doc("of the choice")] = "cpu"
    accelerator: Annotated[Literal["cpu", "gpu"], Doc("gpu needs torch built with CUDA")] = "cpu"
    devices: Annotated[Count, Le(1024), Doc("processes; with gpu, one on each GPU")] = 1
    strategy: Annotated[str, Doc("Lightning's strategy for several processes")] = "auto"
    precision: Annotated[
        Precision,
        Doc("of training; bf16-mixed is slower on a CPU: backward took 10 times as long (D)"),
    ] = "32-true"
    torch_threads: Annotated[
        Count,
        Le(1024),
        Doc("threads of torch in training; they change the last bits of the weights (D)"),
    ] = 2


@dataclass(frozen=True)
class MachineSettings(Settings):
    """Config group `machine`: what affects the time of the method but not its results."""

    name: Annotated[str, Doc("of the choice")] = "local"
    threads: Annotated[
        Count, Le(1024), Doc("threads of networks, renderer, refiner, search and OpenCV each (D)")
    ] = 2
    device: Annotated[
        Device, Doc("device of the networks in detection; cuda needs onnxruntime-gpu")
    ] = "cpu"


@dataclass(frozen=True)
class MethodSettings(Settings):
    """The method without any data set: one record per config group, and the seed.

    Equal settings, objects and images give equal poses. The threads of `machine` change only the
    time; its device changes the last bits of the networks' outputs.

    Examples:
        >>> MethodSettings(refinement=PsoSettings(particles=10)).refinement.particles
        10
    """

    seed: Annotated[WholeNumber, Le(2**32 - 1), Doc("every random number follows from it")] = 0
    rendering: ViewsSettings = field(default_factory=ViewsSettings)
    patches: PatchesSettings = field(default_factory=PatchesSettings)
    classifier: ClassifierSettings = field(default_factory=ClassifierSettings)
    encoder: Annotated[EncoderSettings, ENCODERS] = field(default_factory=ContrastiveSettings)
    codebook: Annotated[NeighboursSettings, SEARCHES] = field(default_factory=InvertedListsSettings)
    voting: Annotated[VotingSettings, VOTINGS] = field(default_factory=JointVotingSettings)
    refinement: Annotated[RefinementSettings, REFINERS] = field(default_factory=PsoSettings)
    trainer: TrainerSettings = field(default_factory=TrainerSettings)
    machine: MachineSettings = field(default_factory=MachineSettings)

    def __post_init__(self) -> None:
        """Raise SettingsError where alternatives do not go together."""
        super().__post_init__()
        patches = self.patches
        for part, given, taken in (
            ("holistic", patches.holistic.resolution, classifier.RESOLUTION),
            ("local", patches.local.resolution, encoder.RESOLUTION),
        ):
            if given != taken:
                problem = f"is {given}: the networks take {taken}"
                raise SettingsError(f"patches.{part}.resolution", problem)
        for group, widths, side in (
            ("classifier", self.classifier.widths, classifier.RESOLUTION),
            ("encoder", getattr(self.encoder, "widths", None), encoder.RESOLUTION),
        ):
            most = side.bit_length() - 1  # each layer halves the image
            if widths is not None and not 1 <= len(widths) <= most:
                problem = f"is {list(widths)}: 1 to {most} layers halve patches of {side} px"
                raise SettingsError(f"{group}.widths", problem)
        dimension, multiple = self.encoder.dimension, self.codebook.dimension_multiple
        if dimension % multiple:
            problem = f"is {dimension}: codebook={self.codebook.name} takes multiples of {multiple}"
            raise SettingsError("encoder.dimension", problem)


@dataclass(frozen=True, kw_only=True)
class TrackingSettings(Settings):
    """How objects are followed through a sequence of frames.

    Examples:
        >>> detector.tracker(["bear"], 1, TrackingSettings(min_score=0.7)).settings.min_score
        0.7
    """

    min_score: Annotated[
        Share,
        Doc(
            "probability below which a tracked pose is lost, so that the object is detected again "
            "in that frame, and below which a detected pose is rejected (D)"
        ),
    ] = MIN_SCORE
    search_every: Annotated[
        CountOrNone,
        Doc(
            "frames between two searches for more instances of an object that is tracked; "
            "null: none. An object that is not tracked is searched in every frame (D)"
        ),
    ] = 30
    prediction: Annotated[
        bool, Doc("start also from where the object is if it has moved on as before (D)")
    ] = True


class StageSettings:
    """Base of what a stage reads of `MethodSettings`: its fields are parts of them, by their names.

    A stage is handed such a record, and its name is made of it. So a setting that a stage reads
    cannot be missing in the name of its output.
    """

    @classmethod
    def of(cls, settings: MethodSettings) -> Self:
        """The part of the settings that the stage reads."""
        values: dict[str, Any] = {}
        for part in fields(cls):  # type: ignore[arg-type]
            kind: Any = part.type
            if isinstance(kind, type) and issubclass(kind, StageSettings):
                values[part.name] = kind.of(settings)
            else:
                of = settings if hasattr(settings, part.name) else settings.patches
                values[part.name] = getattr(of, part.name)
        return cls(**values)

    def named(self) -> dict[str, Any]:
        """What a name is made of: every field, of parts too, but `machine`; its device is added."""
        values = {part.name: getattr(self, part.name) for part in fields(self)}  # type: ignore[arg-type]
        values.pop("machine", None)
        return {
            name: value.named() if isinstance(value, StageSettings) else value
            for name, value in values.items()
        }


@dataclass(frozen=True)
class ViewsStage(StageSettings):
    """Rendering views of an object."""

    seed: int
    rendering: ViewsSettings
    machine: MachineSettings


@dataclass(frozen=True)
class ClassifierStage(StageSettings):
    """Training the classifier of holistic patches."""

    seed: int
    holistic: HolisticSettings
    pool: HolisticPoolSettings
    classifier: ClassifierSettings
    trainer: TrainerSettings
    machine: MachineSettings


@dataclass(frozen=True)
class EncoderStage(StageSettings):
    """Training the encoder of local patches."""

    seed: int
    encoder: EncoderSettings
    local: LocalSettings
    pairs: PairSettings
    trainer: TrainerSettings


@dataclass(frozen=True)
class CodebookStage(StageSettings):
    """Building the codebook of an object."""

    seed: int
    local: LocalSettings
    entries: EntrySettings


@dataclass(frozen=True)
class RegionStage(StageSettings):
    """Finding candidate regions."""

    holistic: HolisticSettings
    region: RegionSettings
    closer_look: CloserLookSettings


@dataclass(frozen=True)
class CoarseStage(StageSettings):
    """Finding coarse poses in regions."""

    local: LocalSettings
    grid: GridSettings
    codebook: NeighboursSettings
    voting: VotingSettings


@dataclass(frozen=True)
class FineStage(StageSettings):
    """Refining coarse poses. The fallback searches regions and coarse poses once more."""

    refinement: RefinementSettings
    templates: TemplateSettings | None


@dataclass(frozen=True)
class FindSettings(StageSettings):
    """Everything that a search over a frame reads."""

    seed: int
    regions: RegionStage
    coarse: CoarseStage
    fine: FineStage
    machine: MachineSettings
