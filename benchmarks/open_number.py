"""Parts in a bin, their number being unknown: how many are found and wrong, and how long it takes.

    python benchmarks/open_number.py bins --seeds 0,1,2 data=bin data_folder=../shared/data

The arguments are a name and overrides of `experiment=recordings`; what is not learnt in `work` is
learnt first. In every frame each kind of part is searched alone, though others lie there too, as
whoever has one CAD model does; then all kinds at once. `open_number.csv` in the working folder
gains a row for each: instances, right ones (ADD-S below a tenth of the diameter, each once),
answers with a score of at least a half and the wrong ones among them; CPU seconds for one instance
of a kind, for all, and for each further one where several are found.
"""

import argparse
import csv
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from hlp.commands.composing import compose_config
from hlp.config.build import build_run
from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.method.find.search import search_frame
from hlp.records import Frame, PoseEstimate, TargetScore
from hlp.refinement.score_model import MIN_SCORE
from hlp.runs.runner import stages_of
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore

MOST = 20  # instances of a kind
COLUMNS = "name", "asked", "instances", "right", "sure", "wrong", "one_s", "all_s", "further_s"
ASKED = "one kind", "all kinds"
Found = list[PoseEstimate]
Times = tuple[float, float, int]
"""CPU seconds for one instance and for all, and how many were found."""


def search(
    stages: DetectionStages, frame: Frame, kinds: Sequence[int], most: int
) -> tuple[Found, float]:
    """Sure answers, and CPU seconds."""
    begun = time.process_time()
    counts = dict.fromkeys(kinds, most)
    context = stages.estimator.prepare(frame)
    found = search_frame(context, counts, min_score=MIN_SCORE, by_threads=False)
    spent = time.process_time() - begun
    answers = []
    for kind, trace in found.items():
        poses = trace.refined.chosen_poses if trace.refined else []
        scores = stages.estimator.score_model(kind).scores(trace.fits)
        of = frame.scene_id, frame.frame_id, kind
        answers += [PoseEstimate(*of, *each) for each in zip(poses, scores, strict=True)]
    return [answer for answer in answers if answer.score >= MIN_SCORE], spent


def search_frames(
    overrides: Sequence[str],
) -> Iterator[tuple[str, list[TargetScore], int, list[Times]]]:
    """What was asked, scores of targets, sure answers, and times of each frame and kind."""
    run = build_run(compose_config("experiment=recordings", "output=out", *overrides))
    stages = stages_of(run, StageStore(Path(run.settings.work)))
    stages.training.make_for(run.dataset.target_ids)
    kinds, frames = run.dataset.target_ids, [stages.load(key) for key in run.keys]
    for kind in kinds:
        search(stages, frames[0], [kind], MOST)  # loads and compiles
    answers: dict[str, Found] = {asked: [] for asked in ASKED}
    times: dict[str, list[Times]] = {asked: [] for asked in ASKED}
    for number, frame in enumerate(frames, 1):
        there = [kind for kind in kinds if any(t.object_id == kind for t in frame.targets)]
        for kind in there:
            _, one = search(stages, frame, [kind], 1)
            found, spent = search(stages, frame, [kind], MOST)
            answers["one kind"] += found
            times["one kind"].append((one, spent, len(found)))
        found, spent = search(stages, frame, there, MOST)
        answers["all kinds"] += found
        times["all kinds"] += [(np.nan, spent / len(there), len(found)) for _ in there]
        print(f"{number} of {len(frames)} frames", file=sys.stderr)
    for asked in ASKED:
        truths, found = map(FrameTruth.of, frames), answers[asked]
        scores = score_targets(truths, run.dataset.models, found, run.settings.evaluation)
        yield asked, scores, len(found), times[asked]


def main() -> None:
    """Search, print and write what was found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", help="of the rows")
    parser.add_argument("--seeds", default="0", help="trainings, as 0,1,2: they are summed up")
    parser.add_argument("overrides", nargs="*", help="of the configuration, as data=bin")
    given = parser.parse_intermixed_args()
    counts = {asked: np.zeros(3, int) for asked in ASKED}
    times: dict[str, list[Times]] = {asked: [] for asked in ASKED}
    for seed in given.seeds.split(","):
        for asked, scores, sure, spent in search_frames([f"seed={seed}", *given.overrides]):
            right = sum(score.add_s_correct for score in scores)
            counts[asked] += len(scores), right, sure
            times[asked] += spent
    path = Path("open_number.csv")
    rows: list[tuple[object, ...]] = [] if path.exists() else [COLUMNS]
    for asked in ASKED:
        targets, right, sure = counts[asked]
        one, spent, each = np.array(times[asked]).T
        more = each > 1
        further = (spent - one)[more].sum() / (each[more] - 1).sum() if more.any() else np.nan
        measured = (one.mean(), spent.mean(), further)  # nan where one alone was not looked for
        seconds = ["" if np.isnan(value) else f"{value:.2f}" for value in measured]
        rows.append((given.name, asked, targets, right, sure, sure - right, *seconds))
        print(*COLUMNS, *rows[-1])
    with path.open("a", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows(rows)


if __name__ == "__main__":
    main()
