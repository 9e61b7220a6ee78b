"""The three stages over frames, with an estimator that only says what it is asked.

A frame whose files are broken costs itself: its files hold the reason, the others their bits.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from fake_detection import (
    KEYS,
    NOT_FOUND,
    OBJECTS,
    CountedFrames,
    FakeEstimator,
    FakeTraining,
    fake_dataset,
    method_settings,
)
from hlp.errors import DataError, MissingFileError
from hlp.method.find.search import MOST_INSTANCES
from hlp.method.find.trace import STAGES, STEPS
from hlp.refinement.score_model import COLORED, MIN_SCORE
from hlp.stages import detection
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore
from hlp.stages.trace_files import read_arrays, read_trace

SETTINGS = method_settings()
FIRST = KEYS[0]


@pytest.fixture(autouse=True)
def fake(monkeypatch):
    monkeypatch.setattr(detection, "PoseEstimator", FakeEstimator)


def stages_in(work, frames=None, **options):
    dataset = SimpleNamespace(**{**vars(fake_dataset()), "frames": frames or CountedFrames()})
    training = FakeTraining(StageStore(work))
    return DetectionStages(dataset, SETTINGS, training, KEYS, **options)


def made_in(work, last="poses"):
    """Stages that are made, up to the last one."""
    stages = stages_in(work)
    stages.make(last)
    return stages


def events(stages, *, reused):
    return [event.stage for event in stages.store.events if event.reused == reused]


def files(work):
    """All files of arrays by stage and frame."""
    return {f"{path.parts[-3]}/{path.stem}": path.read_bytes() for path in work.glob("*/*/*.npz")}


def test_a_frame_is_decoded_once_for_all_three_stages(tmp_path):
    stages = made_in(tmp_path)
    assert stages.dataset.frames.loads == [*KEYS]
    assert events(stages, reused=False) == [*STAGES]
    assert files(tmp_path).keys() == {f"{stage}/{key}" for stage in STAGES for key in KEYS}
    for stage in STAGES:
        stages.make(stage)
    assert stages.dataset.frames.loads == [*KEYS]  # nothing is asked for twice


def visited(stages):
    """What a visitor that looks at every frame is given."""
    found = {}

    def visit(key, trace):
        assert key not in found and stages.load(key).key == key
        found[key] = trace

    stages.estimates(visit)
    return found


def test_who_visits_the_frames_has_them_decoded_once_and_what_is_on_disk(tmp_path):
    stages = stages_in(tmp_path)
    found = visited(stages)
    assert stages.dataset.frames.loads == [*KEYS] == [*found]
    folders = {stage: output.folder for stage, output in stages.made.items()}
    for key in KEYS:
        stored = read_trace(folders, key)
        assert repr(found[key]) == repr(stored) and set(stored) == {*OBJECTS}
    visited(stages)  # once more, though all is made
    assert stages.dataset.frames.loads == [*KEYS] * 2


def test_frames_that_need_no_work_are_visited_too(tmp_path):
    stages_in(tmp_path).make("hypotheses")
    later, again = stages_in(tmp_path), stages_in(tmp_path)
    later.estimator.fails_at = ("refine", KEYS[1], OBJECTS[0])
    with pytest.raises(KeyboardInterrupt):
        visited(later)
    assert visited(again).keys() == {*KEYS}
    assert again.dataset.frames.loads == [*KEYS]
    third = stages_in(tmp_path)
    assert visited(third).keys() == {*KEYS}
    assert third.dataset.frames.loads == [*KEYS] and third.estimator.asked == []
    fourth = stages_in(tmp_path)
    fourth.estimates(lambda *_: None)  # who does not ask for a frame does not have it decoded
    assert fourth.dataset.frames.loads == []


def test_every_object_goes_through_every_step_once_and_the_first_frame_twice(tmp_path):
    stages = made_in(tmp_path)
    wanted = []
    for key in (FIRST, *KEYS):
        wanted += [("region", key, item) for item in OBJECTS]
        wanted += [(step, key, item) for item in OBJECTS for step in ("hypotheses", "refine")]
    assert stages.estimator.asked == wanted
    assert stages.estimator.loaded == 1


def test_stages_one_at_a_time_write_what_stages_together_write(tmp_path):
    together, apart = made_in(tmp_path / "together"), made_in(tmp_path / "apart", "regions")
    assert events(apart, reused=False) == ["regions"]
    apart.make("hypotheses")
    apart.make("poses")
    assert apart.dataset.frames.loads == [*KEYS] * 3
    assert files(tmp_path / "apart") == files(tmp_path / "together")
    for stage in STAGES:
        assert apart.made[stage].fingerprint == together.made[stage].fingerprint
    assert apart.reused == set()  # its own
    assert [set(estimate.seconds) for estimate in apart.estimates()] == [set(STEPS)] * 6


def test_what_is_on_disk_is_reused_by_name(tmp_path):
    stages_in(tmp_path).make("hypotheses")
    before = files(tmp_path)
    later = made_in(tmp_path)
    assert later.reused == {"regions", "hypotheses"}
    assert events(later, reused=True) == ["regions", "hypotheses"]
    assert {step for step, *_ in later.estimator.asked} == {"refine"}
    assert before.items() <= files(tmp_path).items()
    made_in(tmp_path / "whole")
    assert files(tmp_path / "whole").items() <= files(tmp_path).items()
    third = made_in(tmp_path)
    assert third.reused == {*STAGES} and third.dataset.frames.loads == []


def test_an_interrupted_pass_continues_at_the_frame_where_it_stopped(tmp_path):
    stages = stages_in(tmp_path)
    stages.estimator.fails_at = ("refine", KEYS[1], OBJECTS[1])
    with pytest.raises(KeyboardInterrupt) as caught:
        stages.make("poses")
    assert len(caught.value.__notes__) == 3  # every stage was being made
    assert events(stages, reused=False) == []
    left = [*tmp_path.glob("*/*.partial/*.npz")]
    assert {path.stem for path in left} == {FIRST} and len(left) == 3
    resumed = made_in(tmp_path)
    assert resumed.dataset.frames.loads == [*KEYS[1:]]
    assert resumed.reused == {*STAGES}  # in part: its times are not all its own
    made_in(tmp_path / "whole")
    assert files(tmp_path / "whole").items() <= files(tmp_path).items()
    assert not [*tmp_path.glob("*/*.partial")]


def test_a_frame_of_which_one_stage_is_lacking_is_made_for_all(tmp_path):
    stages = stages_in(tmp_path)
    stages.estimator.fails_at = ("region", KEYS[1], OBJECTS[0])
    with pytest.raises(KeyboardInterrupt):
        stages.make("poses")
    (lost,) = tmp_path.glob(f"poses/*.partial/{FIRST}.npz")
    lost.unlink()  # as a crash between two writes leaves it
    assert made_in(tmp_path).dataset.frames.loads == [*KEYS]


def test_estimates_are_the_cheapest_hypotheses_with_the_times_of_this_pass(tmp_path):
    stages = stages_in(tmp_path)
    estimates = stages.estimates()
    assert [(f"{e.scene_id:06d}_{e.frame_id:06d}", e.object_id) for e in estimates] == [
        (key, item) for key in KEYS for item in OBJECTS
    ]
    for estimate in estimates:
        key = f"{estimate.scene_id:06d}_{estimate.frame_id:06d}"
        if (key, estimate.object_id) == NOT_FOUND:
            assert estimate.pose_cam_obj is None and estimate.score == 0.0
        else:
            frame = stages.dataset.frames.load(key)
            context = stages.estimator.prepare(frame)
            covered = stages.estimator.find_region(context, estimate.object_id).mask.sum()
            fit = context.fits.measure(estimate.object_id, estimate.pose_cam_obj)
            assert [estimate.score] == COLORED.scores([fit], known_present=True)
            np.testing.assert_array_equal(estimate.pose_cam_obj[:3, 3], [2.0, 0.0, covered])
        assert set(estimate.seconds) == set(STEPS)
        assert (estimate.seconds["local"], estimate.seconds["voting"]) == (0.25, 0.125)
        assert 0.0 < estimate.seconds["refinement"] < 0.1


def test_loading_and_compiling_are_the_first_uses_and_no_frames(tmp_path, monkeypatch):
    import time

    monkeypatch.setattr(FakeEstimator, "load", lambda *_: time.sleep(0.3))
    stages = stages_in(tmp_path)
    estimates = stages.estimates()
    assert stages.first_use_seconds is not None and 0.3 <= stages.first_use_seconds < 1.0
    for estimate in estimates:
        assert estimate.seconds["holistic"] + estimate.seconds["refinement"] < 0.1


BAD = KEYS[1]


class BreakingFrames(CountedFrames):
    """Frames of which one cannot be decoded; its targets are known all the same."""

    error: Exception = DataError("depth/000002.png is truncated")

    def load(self, key):
        frame = super().load(key)
        if key == BAD:
            raise self.error
        return frame

    def check(self, key, models):
        """Nothing is seen without decoding."""

    def stated_targets(self, key):
        return ((3, float("nan")),)


def assert_same(stages, sound):
    """All frames but the bad one hold the same bits."""
    for stage, output in stages.made.items():
        for key in set(KEYS) - {BAD}:
            found = read_arrays(output.folder, key)
            expected = read_arrays(sound.made[stage].folder, key)
            assert found.keys() == expected.keys()
            for name in found:
                np.testing.assert_array_equal(found[name], expected[name])


def test_the_others_are_found_bit_for_bit(tmp_path, caplog):
    stages, seen = stages_in(tmp_path / "bad", BreakingFrames(), on_bad_frame="report"), []
    estimates = stages.estimates(lambda key, found: seen.append(key))
    assert seen == [KEYS[0], KEYS[2]]
    assert {(e.scene_id, e.frame_id) for e in estimates} == {(0, 1), (4, 1)}
    assert stages.failed == {BAD: "depth/000002.png is truncated"}
    (line,) = [record.message for record in caplog.records if record.levelname == "WARNING"]
    assert BAD in line and "depth/000002.png is truncated" in line
    assert_same(stages, made_in(tmp_path / "sound"))
    stored = read_trace({"poses": stages.made["poses"].folder}, BAD)
    assert stored == "depth/000002.png is truncated"


def test_another_run_reads_of_the_failure_on_disk(tmp_path):
    stages_in(tmp_path, BreakingFrames(), on_bad_frame="report").estimates()
    again = stages_in(tmp_path, BreakingFrames(), on_bad_frame="report")
    assert len(again.estimates()) == 4
    assert again.failed == {BAD: "depth/000002.png is truncated"}
    with pytest.raises(DataError, match="truncated"):
        stages_in(tmp_path, BreakingFrames()).estimates()


def test_a_frame_known_to_be_bad_is_not_decoded_and_has_a_result_of_its_own(tmp_path):
    frames = CountedFrames()
    stages = stages_in(tmp_path, frames, on_bad_frame="report", bad_frames={BAD: "no image"})
    assert len(stages.estimates()) == 4
    assert frames.loads == [KEYS[0], KEYS[2]]
    assert stages.failed == {BAD: "no image"}
    sound = made_in(tmp_path)
    assert sound.made["poses"].fingerprint != stages.made["poses"].fingerprint
    assert_same(stages, sound)


@pytest.mark.parametrize(
    ("options", "error", "of_files"),
    [
        ({}, DataError("truncated"), True),  # the default of studies, which need every frame
        ({"on_bad_frame": "report"}, MissingFileError("it has gone"), True),  # during the run
        ({"on_bad_frame": "report"}, KeyError("a bug"), True),
        ({"on_bad_frame": "report"}, DataError("truncated"), False),  # its targets are not known
    ],
)
def test_everything_else_ends_the_run(tmp_path, options, error, of_files):
    frames = BreakingFrames()
    frames.error = error
    if not of_files:
        frames = SimpleNamespace(**{n: getattr(frames, n) for n in ("keys", "load", "identity")})
    with pytest.raises(type(error)):
        stages_in(tmp_path, frames, **options).estimates()


def test_where_the_number_is_not_known_up_to_so_many_sure_ones_are_looked_for(
    tmp_path, monkeypatch
):
    asked = []

    def search(_, counts, *, min_score, **__):
        asked.append((counts, min_score))
        return {}

    monkeypatch.setattr(detection, "search_frame", search)
    stages = stages_in(tmp_path)
    frame = stages.load(KEYS[0])
    stages.search(frame)
    known = stages._descriptions(STAGES)
    stages.dataset.search_all = True
    stages.search(frame)
    assert asked == [
        (dict.fromkeys(OBJECTS, 1), None),
        (dict.fromkeys(OBJECTS, MOST_INSTANCES), MIN_SCORE),
    ]
    named = stages._descriptions(STAGES)
    assert all(named[stage][0] != known[stage][0] for stage in STAGES)
