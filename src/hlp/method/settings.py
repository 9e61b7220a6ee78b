"""Settings of the method: everything that decides how objects are learnt and found."""

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal

from hlp.codebook.entries import EntrySettings
from hlp.codebook.inverted_lists import InvertedListsSettings
from hlp.codebook.neighbours import ExactSettings, KdForestSettings
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
from hlp.voting.modes import JointVotingSettings, PaperVotingSettings

EncoderSettings = ContrastiveSettings | AutoencoderSettings | PcaSettings
SearchIndexSettings = ExactSettings | KdForestSettings | InvertedListsSettings
VotingSettings = JointVotingSettings | PaperVotingSettings
RefinementSettings = PsoSettings | IcpSettings | NoneSettings


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

    `device` runs the networks during detection.
    """

    name: str
    threads: int
    device: Literal["cpu", "cuda"]


@dataclass(frozen=True)
class MethodSettings:
    """The method without any data set: one record per config group, and the seed.

    Equal settings, objects and images give equal poses. `machine` changes only the time, apart
    from the last bits of what a GPU computes.
    """

    seed: int
    rendering: ViewsSettings
    patches: PatchesSettings
    classifier: ClassifierSettings
    encoder: EncoderSettings
    codebook: SearchIndexSettings
    voting: VotingSettings
    refinement: RefinementSettings
    trainer: TrainerSettings
    machine: MachineSettings


def settings_to_json(settings: MethodSettings) -> dict[str, Any]:
    return dataclasses.asdict(settings)


def settings_from_json(content: dict[str, Any]) -> MethodSettings:
    from pydantic import TypeAdapter

    return TypeAdapter(MethodSettings).validate_python(content)
