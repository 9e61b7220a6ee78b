"""The method on one frame and one object: window → region → votes → coarse poses → pose."""

import time
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hlp.codebook.inverted_lists import InvertedLists, InvertedListsSettings
from hlp.codebook.neighbours import ExactNeighbours, ExactSettings, KdForest, Neighbours
from hlp.config.settings import RunSettings
from hlp.data.dataset import Dataset
from hlp.method.holistic_scan import HolisticScan
from hlp.method.refiners import make_refiner
from hlp.models.encoder import Encoder
from hlp.patches.holistic import candidate_region, region_weights
from hlp.patches.local import cut_local_patches, region_pixels
from hlp.records import Codebook, Frame, Hypotheses, LocalPatches, Region, Votes
from hlp.refinement.choice import RefinedHypotheses, refine_and_choose
from hlp.refinement.refiner import Refiner
from hlp.refinement.verification import Observation, Verifier, observe
from hlp.stages.training import TrainingStages
from hlp.voting.cast import cast_votes
from hlp.voting.modes import JointModes, JointVotingSettings, ModeFinder, PaperModes


@dataclass(frozen=True)
class CoarseResult:
    """What stage 2 makes of a region: patches, votes and hypotheses, and the time (s) of each."""

    patches: LocalPatches
    votes: Votes
    hypotheses: Hypotheses
    local_seconds: float
    voting_seconds: float


class Detector:
    """Finds one object in one frame; networks and codebooks are loaded when first needed."""

    def __init__(self, dataset: Dataset, settings: RunSettings, training: TrainingStages) -> None:
        self.dataset = dataset
        self.settings = settings
        self.training = training
        self._labels = {object_id: i for i, object_id in enumerate(sorted(dataset.models), start=1)}
        self._searches: dict[int, tuple[Codebook, Neighbours]] = {}
        self._verifiers: dict[int, Verifier] = {}
        self._observed: tuple[Frame, Observation] | None = None
        self._modes = _make_modes(settings)

    @cached_property
    def _scan(self) -> HolisticScan:
        objects = {each: self.dataset.models[each] for each in self.dataset.target_ids}
        patches = self.settings.patches
        return HolisticScan(
            self.training.load_classifier(),
            objects,
            patches.holistic,
            patches.region,
            self.settings.machine.threads,
            self.settings.machine.device,
        )

    @cached_property
    def _encoder(self) -> Encoder:
        return self.training.load_encoder()

    @cached_property
    def _refiner(self) -> Refiner:
        return make_refiner(self.settings)

    def region(self, frame: Frame, object_id: int) -> Region:
        """Stage 1: the candidate region of an object (paper, section 3.1)."""
        patches, model = self.settings.patches, self.dataset.models[object_id]
        windows, classes = self._scan.classify(frame, object_id)
        label = self._labels[object_id]
        shape = (frame.depth.shape[0], frame.depth.shape[1])
        return candidate_region(
            object_id,
            windows,
            classes[:, label],
            classes.argmax(axis=1) == label,
            shape,
            model.diameter / model.holistic_size,
            patches.region,
        )

    def coarse(self, frame: Frame, region: Region) -> CoarseResult:
        """Stage 2: votes of the region's local patches, and their modes (paper, section 3.2)."""
        begun = time.perf_counter()
        patches, model = self.settings.patches, self.dataset.models[region.object_id]
        codebook, search = self._codebook(region.object_id)
        cut = cut_local_patches(
            frame.rgb,
            frame.depth,
            frame.camera_matrix,
            region_pixels(region.mask, patches.grid),
            model.local_size * patches.local.size_scale,
            patches.local,
            patches.grid.min_valid,
            self._encoder.sees_color,
        )
        matches = search.search(self._encoder.encode(cut))
        matched = time.perf_counter()
        voting = self.settings.voting
        patch_weights = None
        if voting.weighted_by_region:
            half = frame.camera_matrix[0, 0] * model.diameter / cut.points_cam[:, 2] / 2.0
            patch_weights = region_weights(region, cut.pixels, half)
        votes = cast_votes(
            cut,
            matches,
            codebook,
            model,
            voting.max_distance,
            voting.weighted_by_distance,
            patch_weights,
        )
        found = self._modes.find(votes, model.centroid)
        return CoarseResult(cut, votes, found, matched - begun, time.perf_counter() - matched)

    def fine(self, frame: Frame, object_id: int, coarse: Hypotheses) -> RefinedHypotheses | None:
        """Stage 3: refine the hypotheses worth it and choose one; None where there is none."""
        if len(coarse) == 0:
            return None
        verification = self.settings.refinement.verification
        return refine_and_choose(
            self._refiner,
            self._verifier(object_id),
            self._observe(frame),
            self.dataset.models[object_id],
            coarse,
            verification.candidates,
            verification.max_improvement,
            derive_seed(self.settings.seed, frame.scene_id, frame.frame_id, object_id),
        )

    def _observe(self, frame: Frame) -> Observation:
        """The frame as poses are compared with it, made once for all objects."""
        if self._observed is None or self._observed[0] is not frame:
            settings = self.settings.refinement.verification
            made = observe(frame.rgb, frame.depth, frame.camera_matrix, settings)
            self._observed = frame, made
        return self._observed[1]

    def _verifier(self, object_id: int) -> Verifier:
        if object_id not in self._verifiers:
            model = self.dataset.models[object_id]
            settings = self.settings.refinement.verification
            self._verifiers[object_id] = Verifier(model, settings)
        return self._verifiers[object_id]

    def _codebook(self, object_id: int) -> tuple[Codebook, Neighbours]:
        if object_id not in self._searches:
            codebook = self.training.load_codebook(object_id)
            self._searches[object_id] = (codebook, self._make_search(codebook))
        return self._searches[object_id]

    def _make_search(self, codebook: Codebook) -> Neighbours:
        settings = self.settings.codebook
        if isinstance(settings, ExactSettings):
            return ExactNeighbours(codebook.features, settings.neighbours)
        if isinstance(settings, InvertedListsSettings):
            return InvertedLists(codebook.features, settings, self.settings.seed)
        return KdForest(
            codebook.features,
            settings.neighbours,
            settings.trees,
            settings.checks,
            self.settings.seed,
        )


def derive_seed(*parts: int) -> int:
    """One seed of several numbers, so that frames and objects draw apart in any order."""
    return int(np.random.SeedSequence(parts).generate_state(1)[0])


def _make_modes(settings: RunSettings) -> ModeFinder:
    voting = settings.voting
    if isinstance(voting, JointVotingSettings):
        return JointModes(voting, settings.machine.threads)
    return PaperModes(voting)
