"""Pictures of a run in its folder: some frames, what each stage works with, targets for its page.

<run's folder>/panels/    all poses of some frames, and the panels of one target of each
<run's folder>/stages/    views, training windows, codebook entries, swarms
<run's folder>/report/    what `report.html` shows of missed targets and of some right ones

They are made from what the stages have left on disk. Training windows are composed once more and
the swarm's searches repeated, since neither is kept.
"""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import UInt8

from hlp.arrays import spread
from hlp.config.build import Run
from hlp.progress import Progress
from hlp.records import PoseEstimate, Target, TargetScore, frame_key
from hlp.reporting.figures import save_jpeg
from hlp.reporting.figures.panels import write_picture
from hlp.reporting.figures.stage_figures import swarm_figure, viewpoint_figure
from hlp.reporting.figures.stage_sheets import (
    draw_nearest_entries,
    draw_training_samples,
    draw_view_sheet,
)
from hlp.reporting.figures.target_panels import SeenTarget, ShownPose, draw_overview, draw_panels
from hlp.reporting.page.report_data import CAPTIONS, PANELS, STAGES, ReportDataWriter
from hlp.results.recalls import TargetKey, numbered_targets
from hlp.runs.stage_samples import (
    FrameResults,
    entries_of_patches,
    patches_on_target,
    sample_windows,
    swarms_of_target,
)
from hlp.stages.detection import DetectionStages

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MISSED, RIGHT = 300, 8
"""The largest numbers of missed and of right targets that a run's page shows: each takes some
tenths of a second and 0.2 MB."""
Scored = Mapping[str, Sequence[TargetScore]]
"""The scores of each frame that could be used, in the order of its targets."""
_TARGETS = 6  # whose patches and swarms are drawn
_PATCHES = 2  # of a target

Image = UInt8[np.ndarray, "_ _ 3"]


def draw_pictures(
    run: Run,
    detection: DetectionStages,
    estimates: Sequence[PoseEstimate],
    scores: Sequence[TargetScore],
    output: Path,
) -> None:
    """Write all pictures into `output`, none with `panels=0`; `scores` are in the frames' order.

    Nothing that goes wrong here costs the run its results, nor one picture another: it is logged,
    with its traceback.
    """
    scored: dict[str, list[TargetScore]] = {}
    for score in scores:
        key = frame_key(score.scene_id, score.frame_id)
        if key not in detection.failed:
            scored.setdefault(key, []).append(score)
    pictures = _Pictures(run, detection, estimates, scored, output)
    if run.settings.panels > 0:
        with _logged(f"the pictures in {output / PANELS}"):
            pictures.draw_frames()
        with _logged(f"the pictures in {output / STAGES}"):
            pictures.draw_stages()
    with _logged(f"the pictures of the report in {output}"):
        pictures.keep_report_data({score.object_id for score in scores})


@contextmanager
def _logged(what: str) -> Iterator[None]:
    try:
        yield
    except Exception:
        logging.getLogger(__name__).exception("%s could not be made", what)


class _Shown(NamedTuple):
    """A target that is drawn, in its frame."""

    found: FrameResults
    target: Target
    score: TargetScore

    @property
    def verdict(self) -> str:
        """The verdict on its pose in words."""
        score = self.score
        words = "right" if score.add_correct else "wrong" if score.found else "not found"
        return f"{words} ({score.cause.replace('_', ' ')})" if score.cause else words


class _Pictures:
    def __init__(
        self,
        run: Run,
        detection: DetectionStages,
        estimates: Sequence[PoseEstimate],
        scored: Scored,
        output: Path,
    ) -> None:
        self._run, self._detection, self._training = run, detection, detection.training
        self._scored, self._output = scored, output

        @lru_cache(maxsize=2 * _TARGETS)
        def read(key: str) -> FrameResults:
            return FrameResults.read(detection, key, estimates)

        self._read = read

    def _shown(self, key: str, place: int) -> _Shown:
        found = self._read(key)
        return _Shown(found, found.targets[place], self._scored[key][place])

    @cached_property
    def _drawn(self) -> list[tuple[str, int]]:
        """Keys of the frames that are drawn, each with the place of the target that is."""
        chosen = enumerate(spread(self._run.keys, self._run.settings.panels))
        return [
            (key, number % len(self._scored[key])) for number, key in chosen if key in self._scored
        ]

    def draw_frames(self) -> None:
        """All poses of some frames, spread evenly, and the panels of one target of each in turn."""
        folder = self._output / PANELS
        for key, place in Progress(self._drawn, "pictures", unit="frame"):
            with _logged(f"a picture in {folder}"):
                folder.mkdir(parents=True, exist_ok=True)
                shown = self._shown(key, place)
                write_picture(folder / f"{key}_poses.jpg", self._overview(key))
                name = self._detection.dataset.models[shown.target.object_id].name
                write_picture(folder / f"{key}_{name}.jpg", self._panels(shown))

    def _overview(self, key: str) -> Image:
        found, scores, poses = self._read(key), self._scored[key], []
        for target, score in zip(found.targets, scores, strict=True):
            estimate = found.nearest(target)
            if estimate is not None and estimate.pose_cam_obj is not None:
                model = self._detection.dataset.models[target.object_id]
                words = f"{model.name} {estimate.score:.2f}"
                poses.append(ShownPose(model, estimate.pose_cam_obj, words, score.add_correct))
        right = sum(score.add_correct for score in scores)
        missing = len(scores) - len(poses)
        title = f"{key}: {right} of {len(scores)} targets right"
        title += f", {missing} without an answer" if missing else ""
        return draw_overview(found.frame, poses, title)

    def _panels(self, shown: _Shown) -> Image:
        """The panels of a target with its verdict."""
        found, target = shown.found, shown.target
        best, trace = found.nearest(target), found.trace[target.object_id]
        assert trace.region is not None and trace.votes is not None
        seen = SeenTarget(
            frame=found.frame,
            model=self._detection.dataset.models[target.object_id],
            region=trace.region,
            votes=trace.votes,
            coarse=found.coarse(target.object_id, best),
            estimate=best,
            truth=target,
            score=shown.score,
        )
        return draw_panels(seen)

    def draw_stages(self) -> None:
        """What each stage works with, in place of what was there."""
        folder = self._output / STAGES
        for old in folder.glob("*.jpg"):
            old.unlink()
        draws: dict[str, Callable[[], Image | Figure | None]] = {
            "viewpoints": self._viewpoints,
            "views": self._views,
            "training_windows": self._training_windows,
            "nearest_entries": self._nearest_entries,
            "swarm_costs": lambda: self._swarms(self._drawn[:_TARGETS]),
            "missed_swarm_costs": lambda: self._swarms(missed_targets(self._scored, _TARGETS)),
        }
        assert draws.keys() == CAPTIONS.keys()
        progress = Progress(draws.items(), "pictures of stages", unit="picture")
        for name, draw in progress:
            with _logged(f"a picture in {folder}"):
                picture = draw()
                if isinstance(picture, np.ndarray):
                    write_picture(folder / f"{name}.jpg", picture)
                elif picture is not None:
                    folder.mkdir(parents=True, exist_ok=True)
                    save_jpeg(picture, folder / f"{name}.jpg")

    def _viewpoints(self) -> "Figure":
        first = self._run.dataset.target_ids[0]
        return viewpoint_figure(self._training.load_views(first), self._training.models[first].name)

    def _views(self) -> Image:
        training = self._training
        return draw_view_sheet(
            {training.models[i].name: training.load_views(i) for i in training.classes}
        )

    def _training_windows(self) -> Image:
        images, labels = sample_windows(self._training)
        names = ["background", *(self._training.models[i].name for i in self._training.classes)]
        return draw_training_samples(images, labels, names)

    def _nearest_entries(self) -> Image | None:
        found = []
        for key, place in self._drawn[:_TARGETS]:
            shown = self._shown(key, place)
            patches = patches_on_target(self._training, shown.found, shown.target, _PATCHES)
            found += entries_of_patches(self._training, shown.found.frame, shown.target, patches)
        return draw_nearest_entries(found) if found else None

    def _swarms(self, targets: Sequence[tuple[str, int]]) -> "Figure | None":
        shown = (self._shown(key, place) for key, place in targets)
        swarms = [swarms_of_target(self._detection, s.found, s.target, s.verdict) for s in shown]
        drawn = [swarm for swarm in swarms if swarm is not None]
        return swarm_figure(drawn) if drawn else None

    def keep_report_data(self, object_ids: set[int]) -> None:
        """What the run's page shows beside its results: objects, pictures and scenes."""
        writer, models = ReportDataWriter(self._output), self._detection.dataset.models
        chosen = page_targets(self._scored) if self._run.settings.panels > 0 else []
        for key, frame, place in Progress(chosen, "pictures of targets", unit="target"):
            shown = self._shown(frame, place)
            best, model = shown.found.nearest(shown.target), models[shown.target.object_id]
            poses = (shown.target.pose_cam_obj, None if best is None else best.pose_cam_obj)
            writer.add_target(key, self._panels(shown), shown.found.frame, model, poses)
        writer.write([models[i] for i in sorted(object_ids)])


class PageTarget(NamedTuple):
    """A target on the run's page: its key, its frame's, its place among those of the frame."""

    target: TargetKey
    frame: str
    place: int


def page_targets(scored: Scored) -> list[PageTarget]:
    """Missed targets, and right ones, each spread evenly over the run if there are too many."""
    missed, right = (_targets(scored, verdict) for verdict in (False, True))
    return sorted([*spread(missed, MISSED), *spread(right, RIGHT)])


def missed_targets(scored: Scored, most: int) -> list[tuple[str, int]]:
    """Frames of missed targets and their places, up to a number, spread evenly over the run."""
    return [(missed.frame, missed.place) for missed in spread(_targets(scored, False), most)]


def _targets(scored: Scored, right: bool) -> list[PageTarget]:
    found = []
    for key, scores in scored.items():
        targets = numbered_targets((s.scene_id, s.frame_id, s.object_id) for s in scores)
        for place, (target, score) in enumerate(zip(targets, scores, strict=True)):
            if score.add_correct == right:
                found.append(PageTarget(target, key, place))
    return found
