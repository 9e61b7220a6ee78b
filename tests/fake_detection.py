"""A data set of small frames, and an estimator that finds an object wherever it is told to look.

What it finds depends on the frame and the object alone, so that results can be told apart.
"""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from composed_settings import run_settings
from hlp.method.find.trace import ObjectTrace
from hlp.method.settings import MethodSettings
from hlp.records import Frame, Hypotheses, Region, Target, Votes
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.refiner import Refinement
from hlp.refinement.score_model import COLORED, ScoreModel
from hlp.stages.store import Output, StageStore

OBJECTS = (3, 7)
KEYS = ("000000_000001", "000000_000002", "000004_000001")
SHAPE = (12, 17)  # its pixels fill no whole number of bytes
NOT_FOUND = ("000004_000001", 7)


def method_settings(*overrides: str) -> MethodSettings:
    """The default settings, as `hlp run` would have them."""
    return run_settings(*overrides).method


class CountedFrames:
    """Frames with both objects as targets; `loads` lists the keys of those that were decoded."""

    keys = KEYS

    def __init__(self) -> None:
        self.loads: list[str] = []

    def identity(self) -> str:
        return "frames"

    def load(self, key: str) -> Frame:
        self.loads.append(key)
        scene, frame = (int(part) for part in key.split("_"))
        targets = tuple(Target(object_id, np.eye(4)) for object_id in OBJECTS)
        depth = np.ones(SHAPE, np.float32)
        return Frame(scene, frame, np.zeros((*SHAPE, 3), np.uint8), depth, np.eye(3), targets)


def fake_dataset() -> Any:
    frames = CountedFrames()
    model = SimpleNamespace(holistic_size=0.1, local_size=0.05, diameter=0.12)
    return SimpleNamespace(
        models=dict.fromkeys(OBJECTS, model),
        model_identities={object_id: f"model {object_id}" for object_id in OBJECTS},
        target_ids=OBJECTS,
        frames=frames,
        frames_identity=frames.identity(),
        instances_to_find=lambda frame: dict.fromkeys(
            (target.object_id for target in frame.targets), 1
        ),
        search_all=False,
        settings=None,
    )


class FakeTraining:
    """Training stages that have learnt everything already."""

    def __init__(self, store: StageStore) -> None:
        self.store = store
        self.made: dict[Any, Any] = {}

    def make_for(self, object_ids: tuple[int, ...]) -> None:
        """Nothing is to be made."""

    def classifier(self) -> Output:
        return Output("classifier", Path("classifier"))

    def encoder(self) -> Output:
        return Output("encoder", Path("encoder"))

    def codebook(self, object_id: int) -> Output:
        return Output(f"codebook {object_id}", Path("codebook"))


class FakeEstimator:
    """Stands for `PoseEstimator`. `asked` lists the steps, each with its frame and object.

    `fails_at` names a step, frame and object at which the user presses Ctrl-C.
    """

    def has_templates(self, object_id: int) -> bool:
        return False

    may_be_found_soon = has_templates

    def score_model(self, object_id: int) -> ScoreModel:
        return COLORED

    def __init__(self, *_: Any) -> None:
        self.asked: list[tuple[str, str, int]] = []
        self.fails_at: tuple[str, str, int] | None = None
        self.loaded = 0

    def load(self, object_ids: tuple[int, ...]) -> None:
        self.loaded += 1

    def prepare(self, frame: Frame) -> Any:
        return SimpleNamespace(estimator=self, fits=self, frame=frame, observation=None)

    def verifier(self, object_id: int) -> Any:
        """Nothing is explained by any pose."""
        return SimpleNamespace(
            evidence=lambda *_: None,
            is_free=lambda *_: [True],
            without_explained=lambda observation, _: observation,
        )

    def score(self, *_: Any) -> float:
        return 1.0

    def settle(self, *_: Any) -> None:
        """Nothing hides anything, and nothing is dull."""

    doubt = settle

    def other_regions(self, *_: Any) -> Iterator[Region]:
        return iter(())

    def measure(self, object_id: int, pose: np.ndarray) -> PoseFit:
        """A fit that depends on the pose alone."""
        return PoseFit(0.1 * pose[0, 3], 0.9, 0.9, 3.0, 1.0)

    def _step(self, name: str, context: Any, object_id: int) -> np.random.Generator:
        step = name, context.frame.key, object_id
        if step == self.fails_at:
            raise KeyboardInterrupt
        self.asked.append(step)
        return np.random.default_rng([context.frame.scene_id, context.frame.frame_id, object_id])

    def find_region(self, context: Any, object_id: int, instances: int = 1) -> Region:
        rng = self._step("region", context, object_id)
        centers = rng.integers(0, 12, (5, 2)).astype(np.float64)
        probabilities = rng.random(5).astype(np.float32)
        return Region(object_id, centers, probabilities, rng.random(SHAPE) < 0.5)

    def find_hypotheses(self, context: Any, region: Region) -> ObjectTrace:
        """Hypotheses that lie at the sum of the region's mask: it must have come through."""
        rng = self._step("hypotheses", context, region.object_id)
        votes = Votes(
            rng.random((4, 3)),
            np.broadcast_to(np.eye(3), (4, 3, 3)).copy(),
            rng.random(4),
            np.arange(4),
            rng.integers(0, 12, (4, 2)).astype(np.float64),
        )
        count = 0 if (context.frame.key, region.object_id) == NOT_FOUND else 2
        poses = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
        poses[:, 2, 3] = float(region.mask.sum())
        found = Hypotheses(poses, rng.random(count))
        return ObjectTrace(region, None, votes, found, seconds={"local": 0.25, "voting": 0.125})

    def refine(
        self,
        context: Any,
        object_id: int,
        hypotheses: Hypotheses,
        instances: int = 1,
        unexplained: Any = None,
        min_score: float | None = None,
    ) -> RefinedHypotheses | None:
        """Moves each hypothesis by a metre; the second one costs less."""
        self._step("refine", context, object_id)
        if len(hypotheses) == 0:
            return None
        moved = hypotheses.poses_cam_obj.copy()
        moved[:, 0, 3] += [1.0, 2.0]
        refined = [Refinement(pose, 3) for pose in moved]
        starts = hypotheses.poses_cam_obj[::-1]
        return RefinedHypotheses(refined, np.array([0.5, 0.25]), np.array([1, 0]), starts, (1,))
