"""What each stage reads of the settings: it is handed this record, and its name is made of it.

So a setting that a stage reads cannot be missing in the name of its output. `machine`, which
decides the time but not the result, is left out of names but for the device.
"""

from dataclasses import dataclass, fields
from typing import Any, Self

from hlp.codebook.entries import EntrySettings
from hlp.codebook.neighbours import NeighboursSettings
from hlp.method.settings import MachineSettings, MethodSettings, ScoreSettings, TrainerSettings
from hlp.models.classifier import ClassifierSettings
from hlp.models.encoders import EncoderSettings
from hlp.patches.holistic import HolisticSettings, RegionSettings
from hlp.patches.holistic_pool import HolisticPoolSettings
from hlp.patches.local import GridSettings, LocalSettings
from hlp.patches.local_pool import PairSettings
from hlp.patches.window_choice import CloserSettings
from hlp.refinement.refiner import RefinementSettings
from hlp.rendering.views import ViewsSettings
from hlp.templates.building import TemplateSettings
from hlp.voting.modes import VotingSettings


class StageSettings:
    """Base of the records: their fields are parts of the method's settings, by the same names."""

    @classmethod
    def of(cls, settings: MethodSettings) -> Self:
        """The part of the settings that the stage reads."""
        values: dict[str, Any] = {}
        for field in fields(cls):  # type: ignore[arg-type]
            kind: Any = field.type
            if isinstance(kind, type) and issubclass(kind, StageSettings):
                values[field.name] = kind.of(settings)
            elif hasattr(settings, field.name):
                values[field.name] = getattr(settings, field.name)
            else:
                values[field.name] = getattr(settings.patches, field.name)
        return cls(**values)

    def named(self) -> dict[str, Any]:
        """What a name is made of: every field, also of parts, but the machine."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
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
    closer: CloserSettings


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


@dataclass(frozen=True)
class ScoreStage(StageSettings):
    """Calibrating the score of an object's poses by searches in rendered scenes."""

    find: FindSettings
    rendering: ViewsSettings
    score: ScoreSettings
