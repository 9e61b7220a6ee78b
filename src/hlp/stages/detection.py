"""Stages that find objects in frames: regions, hypotheses, refined poses, frame by frame."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from hlp.data.dataset import Dataset
from hlp.method.pose_estimator import FrameContext, PoseEstimator
from hlp.method.settings import MethodSettings
from hlp.records import Frame, PoseEstimate
from hlp.source_code import Code, code_of
from hlp.stages.executor import each_in_workers
from hlp.stages.executor_settings import ExecutorSettings, SerialSettings
from hlp.stages.fingerprint import fingerprint, result_settings
from hlp.stages.frame_files import read_arrays, write_arrays
from hlp.stages.frame_results import (
    Arrays,
    coarse_arrays,
    hypotheses_of,
    refined_arrays,
    region_arrays,
    regions_of,
)
from hlp.stages.store import Output, StageStore
from hlp.stages.training import TrainingStages

STAGES = ("regions", "hypotheses", "poses")

Seconds = dict[int, dict[str, float]]
"""Wall time by object and step (holistic, local, voting, refinement) in one frame."""


class DetectionStages:
    """Runs the three stages over frames; what is on disk already is not made again.

    `keys` are the frames to look at. Every stage writes one file a frame, so an interrupted run
    goes on where it stopped, and frames may be shared out to workers (`executor`). A frame is
    decoded once, however many of the stages are missing.

    `seconds` holds the times of the frames and steps that were computed by this very object; what
    was found on disk has none; `reused` tells which stages were.
    """

    def __init__(
        self,
        dataset: Dataset,
        settings: MethodSettings,
        training: TrainingStages,
        store: StageStore,
        keys: tuple[str, ...],
        executor: ExecutorSettings | None = None,
    ) -> None:
        self.dataset = dataset
        self.settings = settings
        self.training = training
        self.store = store
        self.keys = keys
        self.executor = executor
        self.estimator = PoseEstimator(training, settings, dataset.target_ids)
        self.seconds: dict[str, Seconds] = {}
        self.first_use_seconds: float | None = None
        self.reused: dict[str, bool] = {}
        self._made: dict[str, Output] = {}

    def regions(self) -> Output:
        """Stage 1: candidate regions of the targets of every frame."""
        return self._make_up_to("regions")

    def hypotheses(self) -> Output:
        """Stage 2: ranked coarse poses of the targets of every frame."""
        return self._make_up_to("hypotheses")

    def poses(self) -> Output:
        """Stage 3: the refined hypotheses of every target, and which of them is the answer."""
        return self._make_up_to("poses")

    def _make_up_to(self, last: str) -> Output:
        """The output of a stage; those before it that are missing are made in the same pass."""
        if last in self._made:
            return self._made[last]
        self.training.make_for(self.dataset.target_ids)
        wanted = STAGES[: STAGES.index(last) + 1]
        described = self._descriptions(wanted)
        with ExitStack() as stack:
            opened = {
                stage: stack.enter_context(self.store.open(stage, name, description))
                for stage, (name, description) in described.items()
            }
            folders = {stage: each.folder for stage, each in opened.items()}
            missing = [stage for stage, each in opened.items() if not each.finished]
            self._find_in_all(folders, missing)
        self.reused |= {
            stage: stage not in missing for stage in described if stage not in self.reused
        }
        for stage, (name, _) in described.items():
            self._made[stage] = Output(name, self.store.root / stage / name)
        return self._made[last]

    def _descriptions(self, stages: Sequence[str]) -> dict[str, tuple[str, Mapping[str, Any]]]:
        """Fingerprint of each stage, and all that decides it."""
        seed = self.settings.seed
        before: dict[str, str] = {}
        described: dict[str, tuple[str, Mapping[str, Any]]] = {}
        for stage in stages:
            settings = {**self._settings_of(stage), "keys": list(self.keys)}
            inputs = {**before, **self._inputs_of(stage), "frames": self.dataset.frames_identity}
            name = fingerprint(stage, self._code(), seed, settings, inputs)
            described[stage] = name, {"settings": settings, "upstream": inputs, "seed": seed}
            before = {stage: name}
        return described

    def _settings_of(self, stage: str) -> dict[str, Any]:
        settings, patches = self.settings, self.settings.patches
        models, device = self.dataset.models, settings.machine.device
        if stage == "regions":
            wanted = {i: models[i] for i in self.dataset.target_ids}
            return {
                "holistic": result_settings(patches.holistic),
                "region": result_settings(patches.region),
                "sizes": {str(i): [m.holistic_size, m.diameter] for i, m in wanted.items()},
                "device": device,
            }
        if stage == "hypotheses":
            return {
                "grid": result_settings(patches.grid),
                "neighbours": result_settings(settings.codebook),
                "voting": result_settings(settings.voting),
                "device": device,
            }
        return {"refinement": result_settings(settings.refinement)}

    def _inputs_of(self, stage: str) -> dict[str, str]:
        training, objects = self.training, self.dataset.target_ids
        if stage == "regions":
            return {"classifier": training.classifier().fingerprint}
        models = {f"model_{i}": self.dataset.model_identities[i] for i in objects}
        if stage == "poses":
            return models
        codebooks = {f"codebook_{i}": training.codebook(i).fingerprint for i in objects}
        return {"encoder": training.encoder().fingerprint, **codebooks, **models}

    def _code(self) -> Code:
        """The code of all three stages, that of alternatives from other packages included."""
        chosen = (self.settings.codebook, self.settings.voting, self.settings.refinement)
        return code_of("hlp.stages.frame_results", *sorted({type(s).__module__ for s in chosen}))

    @property
    def made(self) -> Mapping[str, Output]:
        """The outputs of the stages asked for so far, by stage."""
        return dict(self._made)

    def adopt(self, made: Mapping[str, Output]) -> None:
        """Use outputs that other stages with the same settings have made or found."""
        self._made |= made

    def _find_in_all(self, folders: Mapping[str, Path], missing: Sequence[str]) -> None:
        left = [
            key
            for key in self.keys
            if not all((folders[stage] / f"{key}.npz").exists() for stage in missing)
        ]
        with tqdm(desc=" + ".join(missing), unit="frame", total=len(left), disable=None) as bar:
            for key, seconds in self._each(folders, missing, left):
                self.seconds[key] = seconds
                bar.update()

    def _each(
        self, folders: Mapping[str, Path], missing: Sequence[str], keys: Sequence[str]
    ) -> Iterator[tuple[str, Seconds]]:
        """Find in all frames, here or in workers: the same files. Yields keys as they come."""
        if self.executor is None or isinstance(self.executor, SerialSettings):
            for key in keys:
                yield key, self.find(key, folders, missing)
        elif keys:
            from hlp.stages.frame_task import FrameTask

            yield from each_in_workers(
                self.executor, FrameTask.of(self, folders, tuple(missing)), keys
            )

    def find(self, key: str, folders: Mapping[str, Path], missing: Sequence[str]) -> Seconds:
        """Write one frame's files of the missing stages; the time of each object's steps.

        The first frame is looked at twice: what is loaded and compiled then (`first_use_seconds`)
        is no part of its time.
        """
        frame = self.dataset.frames.load(key)
        if self.first_use_seconds is None:
            begun = time.perf_counter()
            self.estimator.load(self.dataset.target_ids)
            self._find(frame, folders, missing)
            self.first_use_seconds = time.perf_counter() - begun
        found, seconds = self._find(frame, folders, missing)
        for stage in missing:
            write_arrays(folders[stage], key, found[stage])
        return seconds

    def _find(
        self, frame: Frame, folders: Mapping[str, Path], missing: Sequence[str]
    ) -> tuple[dict[str, Arrays], Seconds]:
        """Arrays of all stages of one frame, found now or read from disk; times of those found."""
        seconds: Seconds = {object_id: {} for object_id in self.dataset.wanted(frame)}
        found: dict[str, Arrays] = {}
        context = self.estimator.prepare(frame)
        for stage, folder in folders.items():
            if stage in missing:
                found[stage] = self._stage_arrays(stage, context, found, seconds)
            else:
                found[stage] = read_arrays(folder, frame.key)
        return found, seconds

    def _stage_arrays(
        self, stage: str, context: FrameContext, before: Mapping[str, Arrays], seconds: Seconds
    ) -> Arrays:
        shape = (context.frame.depth.shape[0], context.frame.depth.shape[1])
        regions = regions_of(before["regions"], shape) if stage == "hypotheses" else {}
        arrays: Arrays = {}
        for object_id, spent in seconds.items():
            begun = time.perf_counter()
            if stage == "regions":
                region = self.estimator.find_region(context, object_id)
                spent["holistic"] = time.perf_counter() - begun
                arrays |= region_arrays(region)
            elif stage == "hypotheses":
                coarse = self.estimator.find_hypotheses(context, regions[object_id])
                spent |= {"local": coarse.local_seconds, "voting": coarse.voting_seconds}
                arrays |= coarse_arrays(object_id, coarse)
            else:
                hypotheses = hypotheses_of(before["hypotheses"], object_id)
                refined = self.estimator.refine(context, object_id, hypotheses)
                spent["refinement"] = time.perf_counter() - begun
                arrays |= refined_arrays(object_id, refined)
        return arrays

    def estimates(self) -> list[PoseEstimate]:
        """The answer for every object looked for, with the times measured by this object."""
        folder = self.poses().folder
        answers = []
        for key in self.keys:
            stored, seconds = read_arrays(folder, key), self.seconds.get(key, {})
            scene_id, frame_id = (int(part) for part in key.split("_"))
            for name in sorted({entry.split("/")[0] for entry in stored}, key=int):
                spent = seconds.get(int(name), {})
                answers.append(_estimate(scene_id, frame_id, int(name), stored, spent))
        return answers


def _estimate(
    scene_id: int, frame_id: int, object_id: int, stored: Arrays, seconds: dict[str, float]
) -> PoseEstimate:
    pose, score = None, 0.0
    if f"{object_id}/best" in stored:
        best = int(stored[f"{object_id}/best"])
        pose = stored[f"{object_id}/poses"][best]
        score = float(np.clip(1.0 - stored[f"{object_id}/costs"][best], 0.0, 1.0))
    return PoseEstimate(scene_id, frame_id, object_id, pose, score, seconds)
