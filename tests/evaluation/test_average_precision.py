"""BOP's average precision against plain loops over answers, limits and recalls."""

import numpy as np
import pytest
from boxes import EXTENTS, TRUE, box_model
from scipy.spatial.transform import Rotation

from hlp.evaluation.average_precision import MOST_ANSWERS, average_precision
from hlp.evaluation.evaluator import FrameTruth
from hlp.geometry import rigid
from hlp.records import PoseEstimate, Target

K = np.array([[570.0, 0.0, 81.3], [0.0, 560.0, 58.6], [0.0, 0.0, 1.0]])
HALF_TURN = rigid(Rotation.from_euler("z", 180, degrees=True).as_matrix(), np.zeros(3))
MODELS = {
    1: box_model(EXTENTS, 1, "plain", fine=False),
    2: box_model((0.05, 0.04, 0.03), 2, "turned", np.stack([np.eye(4), HALF_TURN]), fine=False),
    3: box_model(EXTENTS, 3, "absent", fine=False),
}


def _pose(rng, spread):
    turned = TRUE.copy()
    turned[:3, :3] = Rotation.from_rotvec(rng.normal(0, 5 * spread, 3)).as_matrix() @ TRUE[:3, :3]
    turned[:3, 3] += rng.normal(0, spread, 3)
    return turned


def _scenes(seed, images=6):
    """Images with up to three instances, of which some are hidden; answers near and far, some
    where the object is not, and images without answers or without objects."""
    rng = np.random.default_rng(seed)
    truths, estimates = [], []
    for image in range(images):
        targets = []
        for object_id in (1, 2):
            for _ in range(rng.integers(0, 4) if image else 0):
                visible = rng.choice([0.05, 0.4, 1.0, np.nan])
                targets.append(Target(object_id, _pose(rng, 0.15), float(visible)))
        truths.append(FrameTruth(0, image, K, 1280, tuple(targets)))
        if image == images - 1:
            continue
        for target in targets:
            for spread in rng.choice([0.002, 0.01, 0.03], rng.integers(0, 3)):
                pose = target.pose_cam_obj.copy()
                pose[:3, 3] += rng.normal(0, spread, 3)
                if target.object_id == 2 and rng.random() < 0.5:
                    pose = pose @ HALF_TURN
                estimates.append(PoseEstimate(0, image, target.object_id, pose, rng.random()))
        for object_id in (1, 2, 3):
            estimates.append(PoseEstimate(0, image, object_id, _pose(rng, 0.1), rng.random()))
    estimates.append(PoseEstimate(0, images + 5, 1, TRUE, 1.0))  # of an image that is not scored
    return truths, estimates


def _distances(truth, target, estimate, vertices, symmetries):
    """The largest distance of any vertex, and of any projection, to the nearest symmetric pose."""
    moved = vertices @ estimate[:3, :3].T + estimate[:3, 3]
    best = [np.inf, np.inf]
    for motion in symmetries:
        true = target @ motion
        points = vertices @ true[:3, :3].T + true[:3, 3]
        pixels = [(K @ (p / p[:, 2:]).T).T[:, :2] for p in (moved, points)]
        best[0] = min(best[0], max(np.linalg.norm(moved - points, axis=1)))
        best[1] = min(best[1], max(np.linalg.norm(pixels[0] - pixels[1], axis=1)))
    return best


def _reference(truths, estimates, error, limits):
    """Average precision of one error over limits, objects and 101 recalls."""
    means = []
    for object_id, model in MODELS.items():
        if not any(
            _counts(t) for truth in truths for t in truth.targets if t.object_id == object_id
        ):
            continue
        for limit in limits(model):
            verdicts, instances = [], 0
            for truth in truths:
                targets = [t for t in truth.targets if t.object_id == object_id]
                instances += sum(map(_counts, targets))
                own = [
                    e for e in estimates if (e.frame_id, e.object_id) == (truth.frame_id, object_id)
                ]
                free = dict(enumerate(targets))
                for answer in sorted(own, key=lambda e: -e.score):
                    near = [
                        (distance, number)
                        for number, target in free.items()
                        if (
                            distance := _distances(
                                truth,
                                target.pose_cam_obj,
                                answer.pose_cam_obj,
                                model.mesh.vertices,
                                model.symmetries,
                            )[error]
                        )
                        < limit
                    ]
                    if not near:
                        verdicts.append((answer.score, False))
                    elif _counts(free.pop(min(near)[1])):
                        verdicts.append((answer.score, True))
            curve, right = [], 0
            for number, (_, verdict) in enumerate(sorted(verdicts, reverse=True), start=1):
                right += verdict
                curve.append((right / instances, right / number))
            at = [max([p for r, p in curve if r >= level], default=0.0) for level in LEVELS]
            means.append((object_id, np.mean(at)))
    ids = {object_id for object_id, _ in means}
    return np.mean([np.mean([m for i, m in means if i == object_id]) for object_id in ids])


def _counts(target):
    return not target.visible_fraction < 0.1


LEVELS = np.linspace(0, 1, 101)
STEPS = np.arange(1, 11)


def by_diameter(model):
    """BOP's limits of MSSD for an object."""
    return 0.05 * STEPS * model.diameter


@pytest.mark.parametrize("seed", range(4))
def test_average_precision_is_that_of_plain_loops(seed):
    truths, estimates = _scenes(seed)
    found = average_precision(truths, MODELS, estimates)
    mssd = _reference(truths, estimates, 0, by_diameter)
    mspd = _reference(truths, estimates, 1, lambda model: 5.0 * STEPS * 1280 / 640)
    assert 0.05 < mssd < 0.95
    assert found["mssd"] == pytest.approx(mssd, abs=1e-12)
    assert found["mspd"] == pytest.approx(mspd, abs=1e-12)
    assert found["ap"] == pytest.approx((mssd + mspd) / 2, abs=1e-12)
    lengths = _reference(truths, estimates, 0, lambda model: 0.002 * STEPS)
    assert found["mssd_mm"] == pytest.approx(lengths, abs=1e-12)


def _one(pose, score, image=0, object_id=1):
    return PoseEstimate(0, image, object_id, pose, score)


TRUTHS = [FrameTruth(0, 0, K, 640, (Target(1, TRUE, 1.0),)), FrameTruth(0, 1, K, 640, ())]


def test_an_answer_in_an_image_without_the_object_costs_precision_only_if_it_is_surer():
    far = TRUE.copy()
    far[0, 3] += 1.0
    right = _one(TRUE, 0.5)
    assert average_precision(TRUTHS, MODELS, [right])["ap"] == 1.0
    assert average_precision(TRUTHS, MODELS, [right, _one(far, 0.4, 1)])["ap"] == 1.0
    assert average_precision(TRUTHS, MODELS, [right, _one(far, 0.6, 1)])["ap"] == 0.5
    assert average_precision(TRUTHS, MODELS, [])["ap"] == 0.0
    assert average_precision(TRUTHS[1:], MODELS, [right])["ap"] is None


def test_the_answers_of_an_image_beyond_the_most_do_not_count():
    far = TRUE.copy()
    far[0, 3] += 1.0
    others = [_one(far, 1.0, object_id=3)] * MOST_ANSWERS
    assert average_precision(TRUTHS, MODELS, [*others, _one(TRUE, 0.5)])["ap"] == 0.0
    assert average_precision(TRUTHS, MODELS, [*others[1:], _one(TRUE, 0.5)])["ap"] == 1.0
