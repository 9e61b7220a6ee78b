"""What stages work with and find: results of a frame, training windows, patches, swarms."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from hlp.arrays import Pose, spread
from hlp.codebook.neighbours import ExactNeighbours
from hlp.data.dataset import TrainingImages
from hlp.geometry import allocentric_to_egocentric, inverse, project, transform
from hlp.method.find.trace import Trace
from hlp.method.settings import ClassifierStage
from hlp.patches.local import LocalSettings, cut_local_patches
from hlp.patches.local_pool import cut_view_patches
from hlp.patches.sampling import join
from hlp.records import (
    Codebook,
    Frame,
    LocalPatches,
    ObjectModel,
    PoseEstimate,
    Target,
    Views,
    frame_key,
)
from hlp.refinement.cost import DepthCost
from hlp.refinement.pso import PsoSettings, descend, search
from hlp.refinement.refiner import cost_around
from hlp.refinement.verification import Observation, observe
from hlp.reporting.figures.panels import SeenTarget
from hlp.reporting.figures.stage_figures import PatchEntries, SwarmsOfTarget
from hlp.runs.diagnosis import visible_pixels
from hlp.stages.detection import DetectionStages
from hlp.stages.training import TrainingStages

_PATCHES = 2  # of a target
_ENTRIES = 5  # of a patch
_SWARMS = 5  # of a target
# In place of the settings' pools, which take half a minute.
_WINDOWS, _BACKGROUNDS, _SCENES, _FRAMES = 40, 60, 2, 2


@dataclass(frozen=True)
class FrameResults:
    """A frame with what the stages found in it, and the answers."""

    frame: Frame
    trace: Trace
    estimates: tuple[PoseEstimate, ...]

    @classmethod
    def read(
        cls, detection: DetectionStages, estimates: Sequence[PoseEstimate], key: str
    ) -> "FrameResults":
        """What lies on disk of a frame that did not fail; `estimates` are the run's."""
        here = [e for e in estimates if frame_key(e.scene_id, e.frame_id) == key]
        return cls(detection.load(key), detection.read(key), tuple(here))

    @property
    def targets(self) -> list[Target]:
        """The frame's targets as they are scored: by object, in the order of first appearance."""
        objects = dict.fromkeys(target.object_id for target in self.frame.targets)
        return [target for i in objects for target in self.frame.targets if target.object_id == i]

    def nearest(self, target: Target) -> PoseEstimate | None:
        """The answer for the target's object that is nearest to its true place."""
        place = target.pose_cam_obj[:3, 3]
        own = [e for e in self.estimates if e.object_id == target.object_id]
        posed = [(e, e.pose_cam_obj[:3, 3]) for e in own if e.pose_cam_obj is not None]
        apart = [float(np.linalg.norm(found - place)) for _, found in posed]
        return posed[int(np.argmin(apart))][0] if posed else None

    def coarse(self, object_id: int, estimate: PoseEstimate | None) -> Pose | None:
        """The coarse pose that became the estimate; without an estimate the best one.

        None if there is none.
        """
        found, row = self.trace[object_id], self.row(object_id, estimate)
        if row is not None and found.refined is not None:
            return np.asarray(found.refined.starts[row])
        coarse = found.hypotheses
        return coarse.poses_cam_obj[0] if coarse is not None and len(coarse) else None

    def row(self, object_id: int, estimate: PoseEstimate | None) -> int | None:
        """Which of the object's refined poses is the estimate; None without one."""
        refined = self.trace[object_id].refined
        if estimate is None or estimate.pose_cam_obj is None or refined is None:
            return None
        poses = np.stack([found.pose_cam_obj for found in refined.refined])
        return int(np.abs(poses - estimate.pose_cam_obj).max(axis=(1, 2)).argmin())


class _FewFrames(TrainingImages):
    """The data set's images, with a few of its frames as backgrounds."""

    def load_background_frames(self) -> list[Frame]:
        if (source := self.background_frames) is None:
            return []
        return [source.load(key) for key in spread(source.keys, _FRAMES)]


def sample_windows(
    training: TrainingStages,
) -> tuple[Float[np.ndarray, "n c p p"], Int[np.ndarray, "n"]]:
    """Windows in [-1, 1] as the network takes them, and the class of each (0: background).

    They are composed by the code that composes the training's batches, from smaller pools.
    """
    from hlp.method.learn.classifier_training import training_windows  # takes seconds to import

    stage = ClassifierStage.of(training.settings)
    pool = replace(
        stage.pool,
        per_object=min(stage.pool.per_object, _WINDOWS),
        backgrounds=min(stage.pool.backgrounds, _BACKGROUNDS),
        distractor_scenes=min(stage.pool.distractor_scenes, _SCENES),
    )
    images = training.dataset
    few = _FewFrames(photographs=images.photographs, background_frames=images.background_frames)
    data = training_windows(training.models, training.load_views, few, replace(stage, pool=pool))
    windows, labels = data.compose(data.pool, np.random.default_rng(stage.seed))
    return windows.numpy(), labels.numpy()


def entries_on_target(training: TrainingStages, seen: SeenTarget) -> list[PatchEntries]:
    """Some of the patches that lie on a target and voted for its object.

    Each with the entries of the object that are nearest to it.
    """
    model, frame, target = seen.model, seen.frame, seen.truth
    local = training.settings.patches.local
    size = local.side_of(model.local_size)
    pixels = np.unique(seen.votes.pixels, axis=0).astype(np.int64).reshape(-1, 2)
    visible = visible_pixels(training.dataset.frames, frame, target, model)
    pixels = pixels[visible[pixels[:, 1], pixels[:, 0]]]
    count = min(_PATCHES, len(pixels))
    if count == 0:
        return []
    pixels = pixels[[(2 * i + 1) * len(pixels) // (2 * count) for i in range(count)]]
    image = frame.rgb, frame.depth, frame.camera_matrix
    patches = cut_local_patches(*image, pixels, size, local, 0.0)
    codebook, views = training.load_codebook(model.object_id), training.load_views(model.object_id)
    encoder = training.load_encoder()  # the patches have colour, whether or not it takes that
    given = patches if encoder.sees_color else replace(patches, color=patches.color[..., :0])
    matches = ExactNeighbours(codebook.features, _ENTRIES).search(encoder.encode(given))
    true_places = transform(inverse(target.pose_cam_obj), patches.points_cam)
    shown = []
    for row, entries in enumerate(matches.indices):
        cut = [patches[np.array([row])]]
        cut += [entry_patch(views, codebook, int(entry), size, local) for entry in entries]
        apart = distances_on_object(codebook.points_obj[entries], true_places[row], model)
        name = f"{model.name} {frame.key}"
        shown.append(PatchEntries(name, join(cut), matches.distances[row], apart))
    return shown


def distances_on_object(
    points_obj: Float[np.ndarray, "k 3"], place_obj: Float[np.ndarray, "3"], model: ObjectModel
) -> Float[np.ndarray, "k"]:
    """How far points are from a place on the object (m), or from one that looks the same."""
    places = transform(model.symmetries, place_obj[None])[:, 0]
    return np.asarray(np.linalg.norm(points_obj[:, None] - places, axis=-1).min(axis=1))


def entry_patch(
    views: Views, codebook: Codebook, entry: int, size: float, local: LocalSettings
) -> LocalPatches:
    """The patch of metric `size` (m) that an entry was made from, with colour.

    A codebook keeps the place and the rotation of an entry, but not its view: it is the one whose
    rotation, seen along the ray through that place, is the entry's.
    """
    points = transform(views.poses_cam_obj, codebook.points_obj[entry][None])[:, 0]
    along = np.swapaxes(allocentric_to_egocentric(points), -1, -2) @ views.poses_cam_obj[:, :3, :3]
    view = int(np.abs(along - codebook.rotations_cam_obj[entry]).max(axis=(1, 2)).argmin())
    pixel = np.rint(project(points[view][None], views.camera_matrix)).astype(np.int64)
    return cut_view_patches(views, view, pixel, size, local, True)


class RecordedCost(DepthCost):
    """A cost that keeps what it has said of every swarm, in `rounds`."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.rounds: list[Float[np.ndarray, "particles"]] = []

    def evaluate(self, poses_cam_obj: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "n"]:
        """See `DepthCost.evaluate`."""
        costs = super().evaluate(poses_cam_obj)
        # A copy: the search goes on to write the particles' best costs into the first ones.
        self.rounds.append(costs.copy())
        return costs


def swarms_of_target(
    detection: DetectionStages, found: FrameResults, seen: SeenTarget
) -> SwarmsOfTarget | None:
    """Searches from the coarse poses that a target's object was refined from, done once more.

    The chosen one led to the answer that is nearest to the target. None without a swarm.
    """
    object_id, settings = seen.truth.object_id, detection.settings.refinement
    refined, chosen = found.trace[object_id].refined, found.row(object_id, seen.estimate)
    if refined is None or not isinstance(settings, PsoSettings):
        return None
    rows = range(min(_SWARMS, len(refined.refined)))
    asked = dict.fromkeys([*rows] if chosen is None else [*rows, chosen])
    starts = {row: refined.starts[row] for row in asked}
    swarms = {row: search_again(settings, found, seen.model, starts[row]) for row in asked}
    observed = _observation(settings, found)

    def own_cost(pose_cam_obj: Pose) -> float:
        """In a search that starts from the pose: others may look at another place."""
        cost = cost_around(seen.model, observed, pose_cam_obj, settings.cost)
        return float(cost.evaluate(pose_cam_obj[None])[0])

    return SwarmsOfTarget(
        f"{seen.model.name} {found.frame.key}: {seen.verdict}",
        list(swarms.values()),
        list(swarms).index(chosen) if chosen in swarms else None,
        own_cost(seen.truth.pose_cam_obj),
        None if seen.pose is None else own_cost(seen.pose),
    )


def search_again(
    settings: PsoSettings, found: FrameResults, model: ObjectModel, start: Pose
) -> Float[np.ndarray, "rounds particles"]:
    """Costs of all particles in the swarm of a coarse pose, with random numbers of its own."""
    seen = _observation(settings, found)
    if settings.descent is not None:
        cost = cost_around(model, seen, start, settings.cost)
        start, _ = descend(cost, start, model.centroid, settings.descent)
    edges = seen.edges_of(model)
    cost = RecordedCost(model.proxy, seen.depth, seen.camera_matrix, start, settings.cost, edges)
    search(cost, start, model.centroid, settings, np.random.default_rng(0))
    return np.stack(cost.rounds)


def _observation(settings: PsoSettings, found: FrameResults) -> Observation:
    frame = found.frame
    return observe(frame.rgb, frame.depth, frame.camera_matrix, settings.verification)
