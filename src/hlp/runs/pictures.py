"""Pictures of a run in its folder: some frames, what each stage works with, targets for its page.

<run's folder>/panels/    all poses of some frames, and the panels of one target of each
<run's folder>/stages/    viewpoints, views, training windows, codebook entries, swarms
<run's folder>/report/    what `report.html` shows of missed targets and of some right ones

They are made from what the stages have left on disk. Training windows are composed once more and
the swarm's searches repeated, since neither is kept.
"""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.arrays import grouped, spread
from hlp.config.build import Run
from hlp.progress import Progress
from hlp.records import PoseEstimate, TargetScore, frame_key
from hlp.reporting.figures import save_jpeg, stage_figures
from hlp.reporting.figures.panels import SeenTarget, draw_overview, draw_panels, write_picture
from hlp.reporting.page import report_data
from hlp.results.recalls import TargetKey, numbered_targets
from hlp.runs.stage_samples import FrameResults, entries_on_target, sample_windows, swarms_of_target
from hlp.stages.detection import DetectionStages

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MISSED, RIGHT = 300, 8
"""The largest numbers of missed and of right targets that a run's page shows: each takes some
tenths of a second and 0.2 MB."""
Scored = Mapping[str, Sequence[TargetScore]]
"""The scores of each frame that could be used, in the order of its targets."""
_TARGETS = 6  # whose patches and swarms are drawn


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
    frames = grouped(scores, lambda score: frame_key(score.scene_id, score.frame_id))
    scored = {key: own for key, own in frames.items() if key not in detection.failed}
    pictures = _Pictures(run, detection, estimates, scored, output)
    if run.settings.panels > 0:
        with _logged(f"the pictures in {output / report_data.PANELS}"):
            pictures.draw_frames()
        with _logged(f"the pictures in {output / report_data.STAGES}"):
            pictures.draw_stages()
    with _logged(f"the pictures of the report in {output}"):
        pictures.keep_report_data({score.object_id for score in scores})


@contextmanager
def _logged(what: str) -> Iterator[None]:
    try:
        yield
    except Exception:
        logging.getLogger(__name__).exception("%s could not be made", what)


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
        read = partial(FrameResults.read, detection, estimates)
        self._read = lru_cache(maxsize=2 * _TARGETS)(read)

    def _seen(self, key: str, place: int) -> tuple[FrameResults, SeenTarget]:
        """A target that is drawn, and its frame."""
        found = self._read(key)
        target = found.targets[place]
        best, trace = found.nearest(target), found.trace[target.object_id]
        assert trace.region is not None and trace.votes is not None
        return found, SeenTarget(
            frame=found.frame,
            model=self._detection.dataset.models[target.object_id],
            region=trace.region,
            votes=trace.votes,
            coarse=found.coarse(target.object_id, best),
            estimate=best,
            truth=target,
            score=self._scored[key][place],
        )

    @cached_property
    def _drawn(self) -> list[tuple[str, int]]:
        """Keys of the frames that are drawn, each with the place of the target that is."""
        chosen = enumerate(spread(self._run.keys, self._run.settings.panels))
        scored = self._scored
        return [(key, number % len(scored[key])) for number, key in chosen if key in scored]

    def draw_frames(self) -> None:
        """All poses of some frames, spread evenly, and the panels of one target of each in turn."""
        folder = self._output / report_data.PANELS
        for key, place in Progress(self._drawn, "pictures", unit="frame"):
            with _logged(f"a picture in {folder}"):
                folder.mkdir(parents=True, exist_ok=True)
                targets = [self._seen(key, i)[1] for i in range(len(self._scored[key]))]
                write_picture(folder / f"{key}_poses.jpg", draw_overview(targets[0].frame, targets))
                name = targets[place].model.name
                write_picture(folder / f"{key}_{name}.jpg", draw_panels(targets[place]))

    def draw_stages(self) -> None:
        """What each stage works with, in place of what was there."""
        folder = self._output / report_data.STAGES
        for old in folder.glob("*.jpg"):
            old.unlink()
        draws: dict[str, Callable[[], Figure | None]] = {
            "viewpoints": self._viewpoints,
            "views": self._views,
            "training_windows": self._training_windows,
            "nearest_entries": self._nearest_entries,
            "swarm_costs": self._swarms,
        }
        assert draws.keys() == report_data.CAPTIONS.keys()
        for name, draw in Progress(draws.items(), "pictures of stages", unit="picture"):
            with _logged(f"a picture in {folder}"):
                figure = draw()
                if figure is not None:
                    folder.mkdir(parents=True, exist_ok=True)
                    save_jpeg(figure, folder / f"{name}.jpg")

    def _viewpoints(self) -> "Figure":
        first = self._run.dataset.target_ids[0]
        name = self._training.models[first].name
        return stage_figures.viewpoint_figure(self._training.load_views(first), name)

    def _views(self) -> "Figure":
        training = self._training
        views = {training.models[i].name: training.load_views(i) for i in training.classes}
        return stage_figures.view_sheet(views)

    def _training_windows(self) -> "Figure":
        images, labels = sample_windows(self._training)
        names = ["background", *(self._training.models[i].name for i in self._training.classes)]
        return stage_figures.training_sheet(images, labels, names)

    def _nearest_entries(self) -> "Figure | None":
        targets = (self._seen(key, place)[1] for key, place in self._drawn[:_TARGETS])
        entries = [patch for seen in targets for patch in entries_on_target(self._training, seen)]
        return stage_figures.entries_sheet(entries) if entries else None

    def _swarms(self) -> "Figure | None":
        seen = (self._seen(key, place) for key, place in self._drawn[:_TARGETS])
        swarms = [swarms_of_target(self._detection, *shown) for shown in seen]
        drawn = [swarm for swarm in swarms if swarm is not None]
        return stage_figures.swarm_figure(drawn) if drawn else None

    def keep_report_data(self, object_ids: set[int]) -> None:
        """What the run's page shows beside its results: objects, pictures and scenes."""
        for old in (self._output / report_data.FOLDER).glob("*.jpg"):
            old.unlink()
        targets = []
        chosen = page_targets(self._scored) if self._run.settings.panels > 0 else []
        for key, frame, place in Progress(chosen, "pictures of targets", unit="target"):
            _, seen = self._seen(frame, place)
            targets.append(report_data.keep_target(self._output, key, draw_panels(seen), seen))
        models = (self._detection.dataset.models[i] for i in sorted(object_ids))
        objects = {model.name: report_data.wires_of(model) for model in models}
        report_data.ReportData(objects, targets).write(self._output)


def page_targets(scored: Scored) -> list[tuple[TargetKey, str, int]]:
    """Missed targets, and some right ones, each spread evenly over the run.

    With their frames, and their places among those of the frame.
    """
    found: dict[bool, list[tuple[TargetKey, str, int]]] = {True: [], False: []}
    for key, scores in scored.items():
        targets = numbered_targets((s.scene_id, s.frame_id, s.object_id) for s in scores)
        for place, (target, score) in enumerate(zip(targets, scores, strict=True)):
            found[score.add_correct].append((target, key, place))
    return sorted([*spread(found[False], MISSED), *spread(found[True], RIGHT)])
