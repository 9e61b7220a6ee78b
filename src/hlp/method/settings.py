"""Settings of the method: everything that decides how objects are learnt and found."""

from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal

from annotated_types import Ge

from hlp.codebook.entries import EntrySettings
from hlp.codebook.inverted_lists import InvertedListsSettings
from hlp.codebook.neighbours import SEARCHES, SearchSettings
from hlp.models import classifier, encoder
from hlp.models.classifier import ClassifierSettings
from hlp.models.contrastive import ContrastiveSettings
from hlp.models.encoders import ENCODERS, EncoderSettings
from hlp.patches.holistic import HolisticSettings, RegionSettings
from hlp.patches.holistic_pool import HolisticPoolSettings
from hlp.patches.local import GridSettings, LocalSettings
from hlp.patches.local_pool import PairSettings
from hlp.refinement.pso import PsoSettings
from hlp.refinement.refiner import REFINERS, RefinementSettings
from hlp.rendering.views import ViewsSettings
from hlp.settings import Doc, Settings, SettingsError, read_settings
from hlp.voting.modes import VOTINGS, JointVotingSettings, VotingSettings


@dataclass(frozen=True)
class PatchesSettings(Settings):
    """Config group `patches`: one record per step that cuts or chooses patches."""

    name: Annotated[str, Doc("of the choice")] = "hlp"
    holistic: HolisticSettings = field(default_factory=HolisticSettings)
    region: RegionSettings = field(default_factory=RegionSettings)
    pool: HolisticPoolSettings = field(default_factory=HolisticPoolSettings)
    local: LocalSettings = field(default_factory=LocalSettings)
    grid: GridSettings = field(default_factory=GridSettings)
    pairs: PairSettings = field(default_factory=PairSettings)
    entries: EntrySettings = field(default_factory=EntrySettings)


@dataclass(frozen=True)
class TrainerSettings(Settings):
    """Config group `trainer`: what Lightning's Trainer is given."""

    name: Annotated[str, Doc("of the choice")] = "cpu"
    accelerator: Annotated[str, Doc("cpu, or gpu, for which torch must be built with CUDA")] = "cpu"
    devices: Annotated[int, Ge(1), Doc("processes; one a GPU")] = 1
    strategy: Annotated[str, Doc("how processes share out a batch")] = "auto"
    precision: Annotated[
        str, Doc("bf16-mixed is slower on a CPU: its backward pass took 10 times as long (D)")
    ] = "32-true"
    torch_threads: Annotated[
        int,
        Ge(1),
        Doc("of every network; decides the last bits of sums, so it is part of results (D)"),
    ] = 2


@dataclass(frozen=True)
class MachineSettings(Settings):
    """Config group `machine`: what decides how long the method takes, and no result.

    But for the last bits of what a GPU computes.
    """

    name: Annotated[str, Doc("of the choice")] = "local"
    threads: Annotated[
        int, Ge(1), Doc("of the renderer, the refiner, the search and OpenCV each (D)")
    ] = 2
    device: Annotated[Literal["cpu", "cuda"], Doc("of the networks during detection")] = "cpu"


@dataclass(frozen=True)
class MethodSettings(Settings):
    """The method without any data set: one record per config group, and the seed.

    Equal settings, objects and images give equal poses. `machine` changes only the time, apart
    from the last bits of what a GPU computes.
    """

    seed: Annotated[int, Ge(0), Doc("every random number follows from it")] = 0
    rendering: ViewsSettings = field(default_factory=ViewsSettings)
    patches: PatchesSettings = field(default_factory=PatchesSettings)
    classifier: ClassifierSettings = field(default_factory=ClassifierSettings)
    encoder: Annotated[EncoderSettings, ENCODERS] = field(default_factory=ContrastiveSettings)
    codebook: Annotated[SearchSettings, SEARCHES] = field(default_factory=InvertedListsSettings)
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
        dimension, multiple = self.encoder.dimension, self.codebook.dimension_multiple
        if dimension % multiple:
            problem = f"is {dimension}: codebook={self.codebook.name} takes multiples of {multiple}"
            raise SettingsError("encoder.dimension", problem)


def settings_to_json(settings: MethodSettings) -> dict[str, Any]:
    """The settings as plain values, as JSON can hold them."""
    return asdict(settings)


def settings_from_json(content: dict[str, Any]) -> MethodSettings:
    """The settings of plain values. Raises ConfigError naming the key that is wrong."""
    return read_settings(MethodSettings, content)
