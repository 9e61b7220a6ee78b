"""Stages that find objects in frames: regions, hypotheses, refined poses, frame by frame."""

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hlp.codebook.entries import load_codebook
from hlp.data.dataset import CheckedFrames, Dataset
from hlp.errors import DataError, InputError
from hlp.method.find.estimator import PoseEstimator
from hlp.method.find.search import MOST_INSTANCES, search_frame
from hlp.method.find.trace import STAGES, STEPS, Stage, Trace
from hlp.method.learn.model_files import load_classifier
from hlp.method.settings import FindSettings, MethodSettings
from hlp.progress import Progress
from hlp.records import Frame, PoseEstimate, parse_frame_key
from hlp.refinement.score_model import MIN_SCORE
from hlp.stages.executor_settings import ExecutorSettings
from hlp.stages.manifest import Description, described, device_name, fingerprint, stage_code
from hlp.stages.store import Output
from hlp.stages.trace_files import has_arrays, read_trace, write_failure, write_trace
from hlp.stages.training import TrainingStages

Visit = Callable[[str, Trace], None]
"""Is given a frame's key and what the stages have written of it."""
Seconds = dict[int, dict[str, float]]
"""Wall time (s) by object and step in one frame."""
OnBadFrame = Literal["report", "fail"]
"""Whether a frame that cannot be used counts as missed, or ends the run."""


class DetectionStages:
    """Runs the three stages over frames, and reuses what is on disk.

    `keys` are the frames to process. Every stage writes one file per frame, so an interrupted run
    continues where it stopped, and frames can be distributed to workers (`executor`). A frame is
    decoded once (`load`), however many of the stages are missing; whoever else needs its images
    takes them in the same pass, see `estimates`.

    `made` holds the outputs of the stages requested so far, `seconds` the times, by frame, of what
    this object has computed itself. `reused` names the stages for which at least one frame was
    found on disk; that frame has no time.
    `first_use_seconds` is the time of the first frame, with everything that is loaded and compiled
    for it (None: this process has processed no frame). It is not part of any frame's time.
    `cpu_seconds` is the CPU time of all threads for the frames that `seconds` holds, as far as no
    workers have processed them.

    `bad_frames` are known to be unusable, with the reasons; they are not decoded. With
    `on_bad_frame` "report", a frame whose files turn out to be broken joins them (`failed`), and
    its files hold nothing but the reason; with "fail" its error is raised.
    """

    def __init__(
        self,
        dataset: Dataset,
        settings: MethodSettings,
        training: TrainingStages,
        keys: tuple[str, ...],
        executor: ExecutorSettings | None = None,
        on_bad_frame: OnBadFrame = "fail",
        bad_frames: Mapping[str, str] | None = None,
    ) -> None:
        self.dataset, self.settings = dataset, settings
        self.find_settings = FindSettings.of(settings)
        self.training, self.store, self.keys = training, training.store, keys
        self.executor, self.on_bad_frame = executor, on_bad_frame
        self.bad_frames = dict(bad_frames or {})
        self.failed = dict(self.bad_frames)
        self.load = lru_cache(maxsize=1)(dataset.frames.load)
        self.estimator = PoseEstimator(training, self.find_settings, dataset.target_ids)
        self.seconds: dict[str, Seconds] = {}
        self.first_use_seconds: float | None = None
        self.cpu_seconds = 0.0
        self.reused: set[str] = set()
        self.made: dict[str, Output] = {}

    def make(self, last: Stage, visit: Visit | None = None) -> Output:
        """The output of a stage; those before it that are missing are made in the same pass.

        `regions` are candidate regions of the targets of every frame, `hypotheses` ranked coarse
        poses, `poses` the refined hypotheses, and which of them were chosen.
        """
        if last in self.made and visit is None:
            return self.made[last]
        self.training.make_for(self.dataset.target_ids)
        named = self._descriptions(STAGES[: STAGES.index(last) + 1])
        with ExitStack() as stack:
            stacks = {stage: stack.enter_context(ExitStack()) for stage in named}
            opened = {
                stage: stacks[stage].enter_context(self.store.open(stage, name, description))
                for stage, (name, description) in named.items()
            }
            folders = {stage: folder for stage, (folder, _) in opened.items()}
            missing = [stage for stage, (_, finished) in opened.items() if not finished]
            self.reused |= opened.keys() - {*missing} - self.made.keys()
            bar = " + ".join(missing) or "frames"
            for key in Progress(self._process(folders, missing), bar, len(self.keys), unit="frame"):
                if visit is not None:
                    self._visit(key, read_trace(folders, key), visit)
            for own in stacks.values():
                own.close()  # publishes what was made, in the order of the stages
        for stage, (name, _) in named.items():
            self.made[stage] = Output(name, self.store.root / stage / name)
        return self.made[last]

    def _visit(self, key: str, found: Trace | str, visit: Visit) -> None:
        """Show a frame to a visitor, or note why it could not be used."""
        if not isinstance(found, str):
            visit(key, found)
            return
        if self.on_bad_frame == "fail":
            raise DataError(found)
        if key not in self.failed:
            logging.getLogger(__name__).warning("frame %s cannot be used: %s", key, found)
        self.failed[key] = found

    def _descriptions(self, stages: Sequence[Stage]) -> dict[Stage, tuple[str, Description]]:
        """Fingerprint of each stage, and everything that it depends on."""
        dataset, before = self.dataset, dict[str, str]()
        common: dict[str, Any] = {
            "device": device_name(self.find_settings.machine.device),
            "keys": list(self.keys),
            "search_all": dataset.search_all and [MOST_INSTANCES, MIN_SCORE],
        }
        if self.bad_frames:
            common["bad_frames"] = sorted(self.bad_frames)
        always = search_frame.__module__, write_trace.__module__, type(dataset.frames).__module__
        named: dict[Stage, tuple[str, Description]] = {}
        for stage in stages:
            settings, inputs, modules = self._made_from(stage)
            upstream = {**before, **inputs, "frames": dataset.frames_identity}
            code = stage_code(*always, *modules)
            of = described(settings | common, upstream, self.settings.seed, code)
            named[stage] = fingerprint(stage, of), of
            before = {stage: named[stage][0]}
        return named

    def _made_from(self, stage: Stage) -> tuple[dict[str, Any], dict[str, str], list[str]]:
        """Settings that the estimator is handed for a stage, inputs, and modules of alternatives.

        The code that all stages run, and what they all depend on, is not among them.
        """
        find, training, objects = self.find_settings, self.training, self.dataset.target_ids
        if stage == "regions":
            models = {i: self.dataset.models[i] for i in objects}
            sizes = {str(i): [m.holistic_size, m.diameter] for i, m in models.items()}
            inputs = {"classifier": training.classifier().fingerprint}
            return find.regions.named() | {"sizes": sizes}, inputs, [load_classifier.__module__]
        inputs = {f"model_{i}": self.dataset.model_identities[i] for i in objects}
        if stage == "poses":
            return find.fine.named(), inputs, [type(find.fine.refinement).__module__]
        inputs |= {f"codebook_{i}": training.codebook(i).fingerprint for i in objects}
        inputs["encoder"] = training.encoder().fingerprint
        chosen = self.settings.encoder, find.coarse.codebook, find.coarse.voting
        modules = [load_codebook.__module__, *(type(choice).__module__ for choice in chosen)]
        return find.coarse.named(), inputs, modules

    def _process(self, folders: Mapping[Stage, Path], missing: Sequence[Stage]) -> Iterator[str]:
        """Process the frames of which a stage is missing, here or in workers, to the same results.

        Yields all keys, each when it is done.
        """
        for key, reason in self.bad_frames.items():
            for stage in missing:
                write_failure(folders[stage], key, reason)
            yield key
        keys = [key for key in self.keys if key not in self.bad_frames]
        done = {key: all(has_arrays(folders[stage], key) for stage in missing) for key in keys}
        if any(done.values()):  # of an interrupted run
            self.reused |= {*missing}
        yield from (key for key in keys if done[key])
        left = [key for key in keys if not done[key]]
        found: Iterable[tuple[str, Seconds]]
        if self.executor is not None and self.executor.parallel and left:
            from hlp.stages.frame_task import Worker  # a worker runs this class in turn

            worker = Worker.of(self.training, self.executor, self.on_bad_frame)
            found = self.executor.each(partial(worker.find, folders, tuple(missing)), left)
        else:
            found = ((key, self.find(key, folders, missing)) for key in left)
        for key, seconds in found:
            before = self.seconds.get(key, {})
            self.seconds[key] = {i: {**before.get(i, {}), **seconds[i]} for i in seconds}
            yield key

    def find(self, key: str, folders: Mapping[Stage, Path], missing: Sequence[Stage]) -> Seconds:
        """Write one frame's files of the missing stages; return the time of each object's steps.

        The first frame is processed twice, so that its time excludes loading and compiling. Of a
        frame whose files are broken the reason is written; its objects have no time.
        """
        try:
            frame = self.load(key)
        except (DataError, InputError) as error:  # a file that has gone ends the run
            if self.on_bad_frame == "fail" or not isinstance(self.dataset.frames, CheckedFrames):
                raise
            for stage in missing:
                write_failure(folders[stage], key, str(error))
            return {}
        given = read_trace(folders, key, [stage for stage in folders if stage not in missing])
        assert not isinstance(given, str)  # a frame that failed has failed in all stages
        if self.first_use_seconds is None:
            begun = time.perf_counter()
            self.estimator.load(self.dataset.target_ids)
            self.search(frame, given, missing[-1])
            self.first_use_seconds = time.perf_counter() - begun
        begun = time.process_time()
        found = self.search(frame, given, missing[-1], recorded=True)
        self.cpu_seconds += time.process_time() - begun
        for stage in missing:
            write_trace(folders[stage], key, stage, found)
        return seconds_of(found)

    def search(
        self,
        frame: Frame,
        given: Trace | None = None,
        last: Stage = "poses",
        recorded: bool = False,
    ) -> Trace:
        """Search a frame up to a stage, in memory; one object at a time, to time each.

        With `recorded`, nothing is missing of what the stages keep.
        """
        begun, counts = time.perf_counter(), self.dataset.instances_to_find(frame)
        unknown = self.dataset.search_all
        return search_frame(
            self.estimator.prepare(frame),
            dict.fromkeys(counts, MOST_INSTANCES) if unknown else counts,
            min_score=MIN_SCORE if unknown else None,
            given=given,
            stop_after=last,
            by_threads=False,
            recorded=recorded,
            begun=begun,
        )

    def read(self, key: str, stages: Sequence[Stage] = STAGES) -> Trace:
        """What stages have found in a frame that did not fail, from disk; made where missing."""
        found = read_trace({stage: self.make(stage).folder for stage in stages}, key)
        assert not isinstance(found, str), f"frame {key} has failed: {found}"
        return found

    def estimates(self, visit: Visit | None = None) -> list[PoseEstimate]:
        """The pose of every object looked for, with the times measured by this object.

        There is none of the frames that `failed`. `visit` is called once for every frame, in any
        order: here, not in a worker, and as soon as the frame is processed, so that `load` has it
        still decoded.
        """
        self.training.make_for(self.dataset.target_ids)
        known, score = not self.dataset.search_all, self.estimator.score_model
        scores = {i: partial(score(i).scores, known_present=known) for i in self.dataset.target_ids}
        self.make("poses", visit or (lambda key, found: None))
        found = list[PoseEstimate]()
        for key in self.keys:
            if key not in self.failed:
                trace, seconds = self.read(key, ("poses",)), self.seconds.get(key, {})
                found += estimates_of(key, trace, seconds, scores)
        return found


def seconds_of(trace: Trace) -> Seconds:
    """The wall time of each object's steps in one frame."""
    return {object_id: dict(found.seconds) for object_id, found in trace.items()}


def estimates_of(
    key: str, trace: Trace, seconds: Seconds, scores: Mapping[int, Callable[..., list[float]]]
) -> list[PoseEstimate]:
    """The instances of every object looked for in a frame, from the trace of the stage `poses`.

    `scores` are `ScoreModel.scores` of the objects by id. There is one estimate, without a pose, of
    an object that was not found. `seconds` are the times measured in that frame; the instances of
    an object share its time equally. An estimate has a time only if every step was measured.
    """
    scene_id, frame_id = parse_frame_key(key)
    estimates = []
    for object_id, found in sorted(trace.items()):
        answers: list[tuple[np.ndarray | None, float]] = [(None, 0.0)]
        if found.refined is not None:
            own = scores[object_id](found.fits)
            answers = list(zip(found.refined.chosen_poses, own, strict=True))
        spent = seconds.get(object_id, {})
        timed = spent if set(STEPS) <= spent.keys() else {}
        shared = {step: of_all / len(answers) for step, of_all in timed.items()}
        estimates += [PoseEstimate(scene_id, frame_id, object_id, *a, shared) for a in answers]
    return estimates
