"""Pictures of what each stage works with: views, training windows, codebook entries, swarms.

They are made from what the stages have left on disk. Training windows are composed once more and
the swarm's searches repeated, since neither is kept.
"""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from tqdm import tqdm

from hlp.config.build import Run, evenly
from hlp.models.encoders import FeatureDecoder
from hlp.records import PoseEstimate, Target, TargetScore, frame_key
from hlp.reporting.figures.panels import write_picture
from hlp.reporting.figures.saving import save_jpeg
from hlp.reporting.figures.swarm_costs import swarm_figure
from hlp.reporting.figures.viewpoints import (
    draw_nearest_entries,
    draw_reconstructions,
    draw_training_samples,
    draw_view_sheet,
    viewpoint_figure,
)
from hlp.reporting.sweep_log import CAPTIONS, STAGES
from hlp.runs.patch_entries import entries_of_patches, patches_on_target, reconstruct
from hlp.runs.stage_panels import FoundInFrame, in_order_of_scores
from hlp.runs.swarm_traces import swarms_of_target
from hlp.runs.training_windows import sample_windows
from hlp.stages.detection import DetectionStages

_TARGETS = 6  # whose patches and swarms are drawn
_PATCHES, _RECONSTRUCTED = 2, 4  # of a target


def draw_stages(
    run: Run,
    detection: DetectionStages,
    estimates: Sequence[PoseEstimate],
    scores: Sequence[TargetScore],
    output: Path,
) -> None:
    """Write `output`/stages/*.jpg in place of what was there, unless `panels` is 0.

    Nothing that goes wrong here costs the run its results, nor one picture another: it is logged,
    with its traceback.
    """
    logger, begun = logging.getLogger(__name__), time.perf_counter()
    folder = output / STAGES
    if run.settings.panels == 0:
        return
    pictures = _Pictures(run, detection, estimates, scores, folder)
    draws = (
        pictures.remove_old,
        pictures.draw_viewpoints,
        pictures.draw_views,
        pictures.draw_training_windows,
        pictures.draw_entries,
        pictures.draw_reconstructions,
        pictures.draw_swarms,
        pictures.draw_swarms_of_missed,
    )
    for draw in tqdm(draws, desc="pictures of stages", unit="picture", disable=None):
        try:
            draw()
        except Exception:
            logger.exception("a picture in %s could not be made", folder)
    logger.info("drawn  %s (%.1f s)", folder.name, time.perf_counter() - begun)


@dataclass(frozen=True)
class _Shown:
    """A target that is drawn, and the verdict on its pose in words."""

    found: FoundInFrame
    target: Target
    verdict: str


@dataclass(frozen=True)
class _Pictures:
    run: Run
    detection: DetectionStages
    estimates: Sequence[PoseEstimate]
    scores: Sequence[TargetScore]
    folder: Path
    _frames: dict[str, FoundInFrame] = field(default_factory=dict, init=False)

    def remove_old(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        for old in self.folder.glob("*.jpg"):
            old.unlink()

    def draw_viewpoints(self) -> None:
        training, first = self.detection.training, self.run.dataset.target_ids[0]
        figure = viewpoint_figure(training.load_views(first), training.models[first].name)
        save_jpeg(figure, self._file("viewpoints"))

    def draw_views(self) -> None:
        training = self.detection.training
        views = {training.models[i].name: training.load_views(i) for i in training.classes}
        write_picture(self._file("views"), draw_view_sheet(views))

    def draw_training_windows(self) -> None:
        training = self.detection.training
        images, labels = sample_windows(training)
        names = ["background", *(training.models[i].name for i in training.classes)]
        picture = draw_training_samples(images, labels, names)
        write_picture(self._file("training_windows"), picture)

    def draw_entries(self) -> None:
        training = self.detection.training
        found = []
        for each in self._targets:
            patches = patches_on_target(training, each.found, each.target, _PATCHES)
            found += entries_of_patches(training, each.found.frame, each.target, patches)
        if found:
            write_picture(self._file("nearest_entries"), draw_nearest_entries(found))

    def draw_reconstructions(self) -> None:
        training, found = self.detection.training, []
        if not isinstance(training.settings.encoder, FeatureDecoder):
            return
        for each in self._targets:
            patches = patches_on_target(training, each.found, each.target, _RECONSTRUCTED)
            name = f"{training.models[each.target.object_id].name} {each.found.frame.key}"
            rebuilt = reconstruct(training, name, patches)
            found += [] if rebuilt is None else [rebuilt]
        if found:
            write_picture(self._file("reconstructions"), draw_reconstructions(found))

    def draw_swarms(self) -> None:
        self._draw_swarms("swarm_costs", self._targets)

    def draw_swarms_of_missed(self) -> None:
        self._draw_swarms("missed_swarm_costs", self._missed())

    def _draw_swarms(self, name: str, targets: Sequence[_Shown]) -> None:
        swarms = [
            swarms_of_target(self.detection, each.found, each.target, each.verdict)
            for each in targets
        ]
        drawn = [each for each in swarms if each is not None]
        if drawn:
            save_jpeg(swarm_figure(drawn), self._file(name))

    def _file(self, name: str) -> Path:
        assert name in CAPTIONS
        return self.folder / f"{name}.jpg"

    @cached_property
    def _targets(self) -> list[_Shown]:
        """The target of each drawn frame whose panels are drawn, too; up to a number."""
        scored, places = self._scored_frames, []
        for number, key in enumerate(evenly(self.run.keys, self.run.settings.panels)):
            if key in scored:
                places.append((key, number % len(scored[key])))
        return [self._read(key, place) for key, place in places[:_TARGETS]]

    def _missed(self) -> list[_Shown]:
        """Missed targets, up to a number, spread evenly over the run."""
        missed = [
            (key, place)
            for key, scores in self._scored_frames.items()
            for place, score in enumerate(scores)
            if not score.add_correct
        ]
        count = min(_TARGETS, len(missed))
        return [self._read(*missed[i * len(missed) // count]) for i in range(count)]

    @cached_property
    def _scored_frames(self) -> dict[str, list[TargetScore]]:
        """Scores of the targets of each frame that could be used, in their order."""
        frames: dict[str, list[TargetScore]] = {}
        for score in self.scores:
            key = frame_key(score.scene_id, score.frame_id)
            if key not in self.detection.failed:
                frames.setdefault(key, []).append(score)
        return frames

    def _read(self, key: str, place: int) -> _Shown:
        if key not in self._frames:
            self._frames[key] = FoundInFrame.read(self.detection, key, self.estimates)
        found, score = self._frames[key], self._scored_frames[key][place]
        words = "right" if score.add_correct else "wrong" if score.found else "not found"
        if score.cause:
            words += f" ({score.cause.replace('_', ' ')})"
        return _Shown(found, in_order_of_scores(found.frame)[place], words)
