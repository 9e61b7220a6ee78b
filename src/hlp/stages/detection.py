"""Stages that find objects in frames: regions, coarse hypotheses, refined poses, frame by frame."""

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from hlp.config.settings import RunSettings, SerialSettings, result_settings
from hlp.data.dataset import Dataset
from hlp.geometry import quaternions
from hlp.method.pose_estimator import CoarseResult, Detector
from hlp.records import Frame, Hypotheses, PoseEstimate, Region
from hlp.refinement.choice import RefinedHypotheses
from hlp.stages.executor import each_in_workers
from hlp.stages.fingerprint import fingerprint
from hlp.stages.frame_files import read_arrays, write_arrays
from hlp.stages.store import Output, StageStore
from hlp.stages.training import TrainingStages

VERSIONS = {"regions": 3, "hypotheses": 5, "poses": 8}

Arrays = dict[str, np.ndarray]


class DetectionStages:
    """Runs the three stages over frames; what is on disk already is not made again.

    `keys` are the frames to look at. Every stage writes one file a frame, so an interrupted run
    goes on where it stopped, and frames may be shared out (config group `executor`).
    """

    def __init__(
        self,
        dataset: Dataset,
        settings: RunSettings,
        training: TrainingStages,
        store: StageStore,
        keys: tuple[str, ...],
    ) -> None:
        self.dataset = dataset
        self.settings = settings
        self.training = training
        self.store = store
        self.keys = keys
        self.detector = Detector(dataset, settings, training)
        self._made: dict[str, Output] = {}

    def regions(self) -> Output:
        """Stage 1: candidate regions of the targets of every frame."""
        patches = self.settings.patches
        settings = {
            "holistic": result_settings(patches.holistic),
            "region": result_settings(patches.region),
            "sizes": {str(i): self._sizes(i) for i in self.dataset.target_ids},
        }
        upstream = {"classifier": self.training.classifier().fingerprint}
        return self._stage("regions", settings, upstream)

    def _regions_of(self, frame: Frame) -> Arrays:
        arrays: Arrays = {}
        for object_id in self.dataset.wanted(frame):
            begun = time.perf_counter()
            region = self.detector.region(frame, object_id)
            arrays |= _region_arrays(region, time.perf_counter() - begun)
        return arrays

    def _sizes(self, object_id: int) -> list[float]:
        model = self.dataset.models[object_id]
        return [model.holistic_size, model.diameter]

    def hypotheses(self) -> Output:
        """Stage 2: ranked coarse poses of the targets of every frame."""
        patches = self.settings.patches
        settings = {
            "grid": result_settings(patches.grid),
            "neighbours": result_settings(self.settings.codebook),
            "voting": result_settings(self.settings.voting),
        }
        regions = self.regions()
        upstream = {"regions": regions.fingerprint, "encoder": self.training.encoder().fingerprint}
        for object_id in self.dataset.target_ids:
            upstream[f"codebook_{object_id}"] = self.training.codebook(object_id).fingerprint
            upstream[f"model_{object_id}"] = self.dataset.model_identities[object_id]
        return self._stage("hypotheses", settings, upstream)

    def _hypotheses_of(self, frame: Frame) -> Arrays:
        found = read_regions(self._made["regions"].folder, frame)
        arrays: Arrays = {}
        for object_id, region in found.items():
            coarse = self.detector.coarse(frame, region)
            arrays |= _coarse_arrays(str(object_id), coarse)
        return arrays

    def poses(self) -> Output:
        """Stage 3: the refined hypotheses of every target, and which of them is the answer."""
        hypotheses = self.hypotheses()
        settings = {"refinement": result_settings(self.settings.refinement)}
        upstream = {"hypotheses": hypotheses.fingerprint}
        for object_id in self.dataset.target_ids:
            upstream[f"model_{object_id}"] = self.dataset.model_identities[object_id]
        return self._stage("poses", settings, upstream)

    def _poses_of(self, frame: Frame) -> Arrays:
        stored = read_arrays(self._made["hypotheses"].folder, frame.key)
        arrays: Arrays = {}
        for object_id in self.dataset.wanted(frame):
            name = str(object_id)
            coarse = Hypotheses(stored[f"{name}/poses"], stored[f"{name}/support"])
            begun = time.perf_counter()
            fine = self.detector.fine(frame, object_id, coarse)
            arrays |= _fine_arrays(name, fine, time.perf_counter() - begun)
        return arrays

    @property
    def made(self) -> Mapping[str, Output]:
        """The outputs of the stages asked for so far, by stage."""
        return dict(self._made)

    def adopt(self, made: Mapping[str, Output]) -> None:
        """Take outputs that another detection of the same settings has made or found."""
        self._made |= made

    def find(self, stage: str, folder: Path, key: str) -> None:
        """Write one frame's file of a stage; what comes before it must have been made."""
        found = {
            "regions": self._regions_of,
            "hypotheses": self._hypotheses_of,
            "poses": self._poses_of,
        }
        write_arrays(folder, key, found[stage](self.dataset.frames.load(key)))

    def _stage(
        self, stage: str, settings: Mapping[str, Any], upstream: Mapping[str, str]
    ) -> Output:
        inputs = {**upstream, "frames": self.dataset.frames_identity}
        decided = {**settings, "keys": list(self.keys)}
        name = fingerprint(stage, VERSIONS[stage], self.settings.seed, decided, inputs)

        def make(folder: Path) -> None:
            left = [key for key in self.keys if not (folder / f"{key}.npz").exists()]
            with tqdm(desc=stage, unit="frame", total=len(left), disable=None) as bar:
                for _ in self._find_all(stage, folder, left):
                    bar.update()

        if stage not in self._made:
            described = {"settings": decided, "upstream": inputs, "seed": self.settings.seed}
            folder = self.store.get_or_make(stage, name, make, described)
            self._made[stage] = Output(name, folder)
        return self._made[stage]

    def _find_all(self, stage: str, folder: Path, keys: Sequence[str]) -> Iterator[str]:
        """Find in all frames, here or in workers: the same files. Yields the keys as they come."""
        executor = self.settings.executor
        if isinstance(executor, SerialSettings):
            for key in keys:
                self.find(stage, folder, key)
                yield key
        else:
            from hlp.stages.frame_task import FrameTask

            yield from each_in_workers(executor, FrameTask.of(self, stage, folder), keys)

    def estimates(self) -> list[PoseEstimate]:
        """The answer for every target, with the time that each stage took."""
        regions, hypotheses = self.regions().folder, self.hypotheses().folder
        poses = self.poses().folder
        answers = []
        for key in self.keys:
            stored = [read_arrays(folder, key) for folder in (regions, hypotheses, poses)]
            scene_id, frame_id = (int(part) for part in key.split("_"))
            for name in sorted({entry.split("/")[0] for entry in stored[2]}, key=int):
                answers.append(_estimate(scene_id, frame_id, name, *stored))
        return answers


def _estimate(
    scene_id: int, frame_id: int, name: str, region: Arrays, coarse: Arrays, fine: Arrays
) -> PoseEstimate:
    local, voting = (float(part) for part in coarse[f"{name}/seconds"])
    seconds = {
        "holistic": float(region[f"{name}/seconds"]),
        "local": local,
        "voting": voting,
        "refinement": float(fine[f"{name}/seconds"]),
    }
    pose, score = None, 0.0
    if f"{name}/best" in fine:
        best = int(fine[f"{name}/best"])
        pose = fine[f"{name}/poses"][best]
        score = float(np.clip(1.0 - fine[f"{name}/costs"][best], 0.0, 1.0))
    return PoseEstimate(scene_id, frame_id, int(name), pose, score, seconds)


def _region_arrays(region: Region, seconds: float) -> Arrays:
    name = str(region.object_id)
    return {
        f"{name}/centers": region.centers.astype(np.float32),
        f"{name}/probabilities": region.probabilities.astype(np.float32),
        f"{name}/mask": np.packbits(region.mask),
        f"{name}/seconds": np.array(seconds),
    }


def _coarse_arrays(name: str, coarse: CoarseResult) -> Arrays:
    """Hypotheses and votes; a vote in single precision is still exact to a micrometre."""
    votes = coarse.votes
    return {
        f"{name}/poses": coarse.hypotheses.poses_cam_obj,
        f"{name}/support": coarse.hypotheses.support,
        f"{name}/vote_centroids": votes.centroids_cam.astype(np.float32),
        f"{name}/vote_quaternions": quaternions(votes.rotations_cam_obj).astype(np.float32),
        f"{name}/vote_weights": votes.weights.astype(np.float32),
        f"{name}/vote_pixels": np.rint(votes.pixels).astype(np.int16),
        f"{name}/seconds": np.array([coarse.local_seconds, coarse.voting_seconds]),
    }


def _fine_arrays(name: str, fine: RefinedHypotheses | None, seconds: float) -> Arrays:
    """Every refined hypothesis, its cost and the coarse one it comes of; `best` is the answer."""
    arrays = {f"{name}/seconds": np.array(seconds)}
    if fine is None:
        return arrays
    return arrays | {
        f"{name}/poses": np.stack([each.pose_cam_obj for each in fine.refined]),
        f"{name}/costs": fine.costs,
        f"{name}/sources": fine.sources,
        f"{name}/best": np.array(fine.best),
    }


def read_regions(folder: Path, frame: Frame) -> dict[int, Region]:
    """Candidate regions of the objects looked for in a frame, from disk."""
    stored = read_arrays(folder, frame.key)
    shape = frame.depth.shape
    regions = {}
    for entry in stored:
        name, _, field = entry.partition("/")
        if field != "mask":
            continue
        bits = np.unpackbits(stored[entry], count=shape[0] * shape[1])
        regions[int(name)] = Region(
            int(name),
            stored[f"{name}/centers"],
            stored[f"{name}/probabilities"],
            bits.reshape(shape).astype(bool),
        )
    return regions
