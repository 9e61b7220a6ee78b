import time
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid
from hlp.records import PoseEstimate
from hlp.studies.bench_times import PartClock, Spent, TimedDetection, share_of_same, summarise_path

HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
MODELS = {1: SimpleNamespace(symmetries=np.stack([np.eye(4), HALF_TURN]))}


def look(frame, place, spent, pose=None):
    times = {part: Spent(ms / 1e3, 2 * ms / 1e3) for part, ms in spent.items()}
    estimate = PoseEstimate(1, frame, 1, pose, 1.0)
    return TimedDetection(estimate, place, times)


def verdicts(*right):
    return [SimpleNamespace(add_correct=verdict) for verdict in right]


def posed(millimetres=0.0, degrees=0.0):
    turn = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    return rigid(turn, np.array([millimetres / 1e3, 0.0, 1.0]))


def test_times_of_first_and_further_objects_and_of_whole_frames():
    looks = [
        look(1, 0, {"windows": 10, "network": 20, "refine": 5}),
        look(1, 1, {"windows": 0, "refine": 7}),
        look(2, 0, {"windows": 30, "network": 40, "refine": 9}),
    ]
    path = summarise_path(looks, verdicts(True, True, False))
    assert path["add_recall"] == pytest.approx(2 / 3)
    assert path["first"]["network"]["median_ms"] == pytest.approx(30)
    assert path["first"]["stage 1"]["median_ms"] == pytest.approx((30 + 70) / 2)
    assert path["first"]["total"]["p95_ms"] == pytest.approx(35 + 0.95 * (79 - 35))
    assert path["first"]["total"]["cpu_ms"] == pytest.approx(35 + 79)
    assert path["further"]["network"]["median_ms"] == 0
    assert path["further"]["total"]["median_ms"] == pytest.approx(7)
    assert path["frame"]["refine"]["median_ms"] == pytest.approx((12 + 9) / 2)


@pytest.mark.parametrize(
    ("pose", "same"),
    [
        (posed(0.9, 0.4), True),
        (posed(1.1, 0.0), False),
        (posed(0.0, 0.6), False),
        (posed() @ HALF_TURN, True),
        (None, False),
    ],
)
def test_poses_are_the_same_within_the_tolerance_up_to_symmetry(pose, same):
    looks = [[look(1, 0, {}, posed())], [look(1, 0, {}, pose)]]
    assert share_of_same(*looks, MODELS, (1.0, 0.5)) == float(same)
    assert share_of_same(looks[1], looks[1], MODELS, (1.0, 0.5)) == 1.0


def spin(seconds):
    begun = time.process_time()
    while time.process_time() - begun < seconds:
        pass


def test_time_is_charged_to_the_part_that_was_entered_last():
    clock = PartClock()
    begun = time.perf_counter()
    clock.enter("idle")
    time.sleep(0.05)
    clock.enter("busy")
    spin(0.03)
    clock.enter("idle")
    time.sleep(0.05)
    spent = clock.stop()
    whole = time.perf_counter() - begun
    assert spent["idle"].wall >= 0.1 and spent["idle"].cpu < 0.03
    assert spent["busy"].wall >= spent["busy"].cpu - 1e-3 and spent["busy"].cpu >= 0.03
    assert sum(times.wall for times in spent.values()) == pytest.approx(whole, abs=2e-3)


def test_time_before_the_first_part_and_after_the_stop_is_nobodys():
    clock = PartClock()
    time.sleep(0.02)
    clock.enter("a")
    first = clock.stop()
    time.sleep(0.02)
    assert first["a"].wall < 0.02
    assert clock.stop() == {}
