"""The method on one frame: windows → region → votes → coarse poses → refined pose."""

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from hlp.arrays import Mask, Pixels, Pose, derive_seed
from hlp.image_edges import color_edges
from hlp.method.find.frame_fits import FrameFits
from hlp.method.find.holistic_scan import FrameWindows, HolisticScan
from hlp.method.find.patch_matching import FrameMatches, LearntObjects, PatchMatching
from hlp.method.find.trace import ObjectTrace, Observer, nobody
from hlp.method.settings import FindSettings
from hlp.models.encoder import Encoder
from hlp.patches.region import (
    candidate_region,
    first_region,
    likely_regions,
    object_radii,
    patch_pixels,
    region_weights,
)
from hlp.records import Frame, Hypotheses, Region
from hlp.refinement.choice import InstanceSearch, KnownRefinements, RefinedHypotheses
from hlp.refinement.icp import align_to_depth
from hlp.refinement.refiner import turned_over
from hlp.refinement.score_model import score_model_of
from hlp.refinement.texture import choose_nearby_by_texture
from hlp.refinement.verification import Observation, VerificationSettings, Verifier, observe
from hlp.rendering.surface import color_grid
from hlp.templates.building import build_templates
from hlp.templates.matching import at_different_places, match_templates, spread_edges
from hlp.threads import ThreadTeam
from hlp.voting.cast import cast_votes


@dataclass(eq=False)
class FrameContext:
    """One frame and the work on it that its objects share. Made by `PoseEstimator.prepare`.

    `mask` is where to look, None: everywhere. `observer` is told which part of a search begins.
    Of each object, `refined` is what was refined so far, `barren` where none of its templates fits.
    """

    estimator: "PoseEstimator"
    frame: Frame
    windows: FrameWindows
    matches: FrameMatches
    verification: VerificationSettings
    mask: Mask | None = None
    observer: Observer = nobody

    def __post_init__(self) -> None:
        self.refined: dict[int, KnownRefinements] = defaultdict(dict)
        self.barren: dict[int, Mask] = defaultdict(partial(np.zeros_like, self.frame.depth, bool))
        rgb = self.frame.rgb  # without `self`, so that a frame's memory is free with the context
        self.color_edges = found = cache(lambda: color_edges(rgb))
        self.near_edges = cache(lambda reach: spread_edges(found(), reach))

    @cached_property
    def observation(self) -> Observation:
        """The frame in the form that the verification compares poses with."""
        of = self.frame.rgb, self.frame.depth, self.frame.camera_matrix, self.verification
        return observe(*of, lambda _: self.color_edges())

    @cached_property
    def fits(self) -> FrameFits:
        """How well poses fit the frame."""
        return FrameFits(self.observation, self.estimator.verifier, self.estimator.score_model)


class PoseEstimator:
    """The three stages for one object in one frame.

    Networks and codebooks are loaded when first needed, or by `load`. `object_ids` are the objects
    that may be requested (default: all learnt ones). Not safe for use by several threads at once,
    but for the stages of different objects in a frame whose shared work is done (`share_work`).
    """

    def __init__(
        self, learnt: LearntObjects, settings: FindSettings, object_ids: Sequence[int] | None = None
    ) -> None:
        self.learnt, self.settings = learnt, settings
        self.object_ids = tuple(learnt.models if object_ids is None else object_ids)
        threads, fine = settings.machine.threads, settings.fine
        self.team = team = ThreadTeam(threads)  # for work on several objects at once
        self.matching = PatchMatching(learnt, settings, self.object_ids, lambda: self.encoder, team)
        self.verifier = cache(lambda i: Verifier(learnt.models[i], fine.refinement.verification))
        """The cost that compares poses of an object, given its id."""
        self.score_model = cache(lambda i: score_model_of(learnt.models[i].mesh.colored))
        self._templates = cache(lambda i, given: build_templates(learnt.models[i], given))
        self._modes = settings.coarse.voting.build(threads)
        self._refiner = fine.refinement.build(threads)

    @cached_property
    def scan(self) -> HolisticScan:
        """The classifier of windows."""
        objects = {i: self.learnt.models[i] for i in self.object_ids}
        settings, threads = self.settings.regions, self.settings.machine.threads
        network = self.learnt.load_classifier()
        return HolisticScan(network, objects, settings.holistic, settings.region, threads)

    @cached_property
    def encoder(self) -> Encoder:
        """The encoder of local patches."""
        return self.learnt.load_encoder()

    def load(self, object_ids: Sequence[int]) -> None:
        """Load the networks and the codebooks of these objects now instead of at first use."""
        _ = self.scan, self.encoder
        for object_id in object_ids:
            _ = self.matching.group(object_id), self.verifier(object_id)
            if self.learnt.models[object_id].mesh.colored:
                color_grid(self.learnt.models[object_id].mesh)

    def prepare(
        self, frame: Frame, mask: Mask | None = None, observer: Observer = nobody
    ) -> FrameContext:
        """The context of a frame, which is passed to the stages of every object in it."""
        observer("windows")
        windows = FrameWindows(self.scan, frame, observer)
        matches = FrameMatches(self.matching, frame, observer)
        verification = self.settings.fine.refinement.verification
        if all(self.learnt.models[object_id].mesh.colored for object_id in self.object_ids):
            verification = replace(verification, tau_image_edge_mm=None)  # nobody would look
        return FrameContext(self, frame, windows, matches, verification, mask, observer)

    def share_work(self, context: FrameContext, object_ids: Iterable[int]) -> None:
        """Do what these objects share in a frame now, and not when the first one needs it."""
        for object_id in object_ids:
            context.windows.classify(object_id)
        _ = context.fits, self.encoder

    def find_region(self, context: FrameContext, object_id: int, instances: int = 1) -> Region:
        """Stage 1: the candidate region of an object (paper, section 3.1), its likeliest part.

        The part grows with the number of `instances` that are to be found by one look at it.
        """
        settings, model = self.settings.regions, self.learnt.models[object_id]
        windows, classes = context.windows.classify(object_id)
        context.observer("region")
        label = list(self.learnt.classes).index(object_id) + 1
        height, width = context.frame.depth.shape
        region = candidate_region(
            object_id,
            windows,
            classes[:, label],
            classes.argmax(axis=1) == label,
            (height, width),
            model.diameter / model.holistic_size,
            settings.region,
        )
        if context.mask is not None:  # where the region has nothing in it, the mask knows better
            both = region.mask & context.mask
            return replace(region, mask=both if both.any() else context.mask)
        radii = object_radii(context.frame, region.centers, model)
        side = settings.region.square_side or 0.0  # then centres of windows alone
        return first_region(region, radii, side, settings.closer_look, instances)

    def other_regions(self, context: FrameContext, region: Region, known: bool) -> Iterator[Region]:
        """Where else to look; at more places if the object is `known` to be in the image."""
        radii = object_radii(context.frame, region.centers, self.learnt.models[region.object_id])
        closer = self.settings.regions.closer_look
        colored = not self.has_templates(region.object_id)
        found = likely_regions(region, radii, closer, known, colored)
        inside = True if context.mask is None else context.mask
        parts = (replace(part, mask=part.mask & inside) for part in found)
        return (part for part in parts if part.mask.any())

    def share_patches(self, context: FrameContext, regions: Iterable[Region]) -> None:
        """Match the regions' local patches now, each once, if objects share them."""
        if self.matching.joint:
            frame = context.frame
            context.matches.share({r.object_id: self._patch_pixels(frame, r) for r in regions})

    def find_hypotheses(
        self, context: FrameContext, region: Region, share: float = 1.0
    ) -> ObjectTrace:
        """Stage 2: votes of a share of the region's patches, and their modes (section 3.2)."""
        begun = time.perf_counter()
        context.observer("cut")
        frame, model = context.frame, self.learnt.models[region.object_id]
        codebook = self.matching.group(region.object_id).codebooks[region.object_id]
        pixels = self._patch_pixels(frame, region, share)
        cut, matches = context.matches.match(region.object_id, pixels)
        matched = time.perf_counter()
        context.observer("vote")
        voting, weights = self.settings.coarse.voting, None
        if voting.weighted_by_region:
            half = frame.camera_matrix[0, 0] * model.diameter / cut.points_cam[:, 2] / 2.0
            weights = region_weights(region, cut.pixels, half)
        votes = cast_votes(
            cut, matches, codebook, model, voting.max_distance, voting.weighted_by_distance, weights
        )
        context.observer("modes")
        found = self._modes.find(votes, model.centroid)
        if self.has_templates(region.object_id):  # votes by colour are more exact
            poses = align_to_depth(found.poses_cam_obj, model, context.observation)
            found = replace(found, poses_cam_obj=poses)
        seconds = {"local": matched - begun, "voting": time.perf_counter() - matched}
        return ObjectTrace(region, cut, votes, found, seconds=seconds)

    def _patch_pixels(self, frame: Frame, region: Region, share: float = 1.0) -> Pixels:
        model = self.learnt.models[region.object_id]
        return patch_pixels(frame, region, model, self.settings.coarse.grid, share)

    def has_templates(self, object_id: int) -> bool:
        """Whether templates are asked for an object: only for one without colours."""
        colored = self.learnt.models[object_id].mesh.colored
        return self.settings.fine.templates is not None and not colored

    def may_be_found_soon(self, object_id: int) -> bool:
        """Whether few patches may do: scores tell right poses, and patches are not shared."""
        unclear = self.has_templates(object_id) or len(self.verifier(object_id).turns) > 1
        return not unclear and not self.matching.joint

    def match_templates(
        self, context: FrameContext, object_id: int, instances: int, unexplained: Observation | None
    ) -> Hypotheses:
        """Coarse poses where the image has the edges of the object's templates.

        There are more for several `instances`; none where `unexplained` has no depth any more.
        """
        settings, model = self.settings.fine.templates, self.learnt.models[object_id]
        assert settings is not None
        context.observer("templates")
        seen = context.observation if unexplained is None else unexplained
        near, barren = context.near_edges(settings.reach), context.barren[object_id]
        where = ~barren if context.mask is None else context.mask & ~barren
        of = near, seen.depth, seen.camera_matrix, model, settings, where, self.team
        found, (x, y) = match_templates(self._templates(object_id, settings), *of)
        barren[y, x] = True
        poses = align_to_depth(found.poses_cam_obj, model, seen)
        costs = self.verifier(object_id).costs(context.observation, poses)
        order = np.argsort(costs - settings.match_weight * found.support, kind="stable")
        chosen = order[at_different_places(poses[order], model, settings.kept_here)]
        chosen = chosen[: settings.kept + settings.kept_further * (instances - 1)]
        return Hypotheses(poses[chosen], np.ones(len(chosen)))

    def refine(
        self,
        context: FrameContext,
        object_id: int,
        hypotheses: Hypotheses,
        instances: int = 1,
        unexplained: Observation | None = None,
        min_score: float | None = None,
        candidates: int | None = None,
    ) -> RefinedHypotheses | None:
        """Stage 3: refine the promising hypotheses and choose the best (paper, section 3.3).

        At most as many `instances` are chosen as there are things that look like the object in what
        others leave (`unexplained`; None: all). The first one with a score below `min_score` is the
        last. At most `candidates` are refined for each (None: as set), one alone `Refiner.soon`.
        """
        if len(hypotheses) == 0:
            return None
        context.observer("screen")
        early = min_score is not None and not self.has_templates(object_id)
        search = InstanceSearch(
            self._refiner.soon() if candidates == 1 else self._refiner,
            self.verifier(object_id),
            context.observation,
            hypotheses,
            self._seed(context.frame, object_id),
            unexplained,
            partial(context.fits.score, object_id),
            min_score,
            context.observer,
            candidates,
            self.score_model(object_id) if early else None,
            # Objects without colours are searched again and again, often from the same poses.
            context.refined[object_id] if self.has_templates(object_id) else {},
        )
        return search.find(instances)

    def turn_over(
        self, context: FrameContext, object_id: int, pose_cam_obj: Pose
    ) -> RefinedHypotheses | None:
        """The pose that a flat part has if it was found upside down; None if it was not."""
        of, seed = self.verifier(object_id), self._seed(context.frame, object_id)
        found = turned_over(self._refiner, of, context.observation, pose_cam_obj, seed)
        if found is None:
            return None
        costs = of.costs(context.observation, found.pose_cam_obj[None])
        return RefinedHypotheses([found], costs, np.array([-1]), pose_cam_obj[None], (0,))

    def follow(self, context: FrameContext, object_id: int, pose_cam_obj: Pose) -> Pose:
        """The pose of an instance that was at `pose_cam_obj` a moment before the frame."""
        seen, model = context.observation, self.learnt.models[object_id]
        seed = self._seed(context.frame, object_id)
        found = self._refiner.follow(model, seen, pose_cam_obj, seed).pose_cam_obj
        return choose_nearby_by_texture(seen, model, found)

    def _seed(self, frame: Frame, object_id: int) -> int:
        return derive_seed(self.settings.seed, frame.scene_id, frame.frame_id, object_id)
