"""All settings of a run, typed: what the configuration becomes before any stage runs."""

import dataclasses
from dataclasses import dataclass
from typing import Any

from hlp.codebook.entries import EntrySettings
from hlp.codebook.neighbours import ExactSettings, KdForestSettings
from hlp.data.bop import BopSettings
from hlp.data.linemod import LinemodSettings
from hlp.data.own_frames import FilesSettings
from hlp.data.synthetic_scenes import SyntheticSettings
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
    """Config group `machine`: `threads` of the numba kernels and of OpenCV."""

    name: str
    threads: int


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
    data: SyntheticSettings | BopSettings | LinemodSettings | FilesSettings
    rendering: ViewsSettings
    patches: PatchesSettings
    classifier: ClassifierSettings
    encoder: ContrastiveSettings | AutoencoderSettings | PcaSettings
    codebook: ExactSettings | KdForestSettings
    voting: JointVotingSettings | PaperVotingSettings
    refinement: PsoSettings | IcpSettings | NoneSettings
    evaluation: EvaluationSettings
    reporting: TrackingSettings
    trainer: TrainerSettings
    machine: MachineSettings


def result_settings(settings: Any) -> dict[str, Any]:
    """Settings that decide a result: all but machine keys, with the record's name."""
    kept = {
        each.name: getattr(settings, each.name)
        for each in dataclasses.fields(settings)
        if each.name not in MACHINE_KEYS
    }
    return {type(settings).__name__: kept}
