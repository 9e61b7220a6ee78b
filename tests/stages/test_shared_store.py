"""One mesh under several ids in one store: what is learnt under one changes nothing of another."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from fake_detection import method_settings
from hlp.data.dataset import Dataset
from hlp.data.synthetic.objects import demo_objects
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages

SMALL = (
    "encoder=pca",
    "rendering.viewpoints=12",
    "rendering.in_plane_steps=1",
    "rendering.size_px=48",
    "patches.pairs.per_object=40",
    "patches.entries.patches_per_view=4",
)


def training_of(object_id: int, work: Path) -> TrainingStages:
    """Training stages of a data set whose only object is the drill, under that id."""
    drill = dataclasses.replace(demo_objects()[5], object_id=object_id)
    dataset = Dataset({object_id: drill}, (object_id,), None, None, None, None)  # type: ignore[arg-type]
    return TrainingStages(dataset, method_settings(*SMALL), StageStore(work))


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which the drill was learnt under id 1, as `hlp predict` does."""
    work = tmp_path_factory.mktemp("shared")
    training_of(1, work).codebook(1)
    return work


def test_what_is_learnt_under_another_id_is_what_a_fresh_store_would_have(
    shared: Path, tmp_path: Path
) -> None:
    again, fresh = training_of(6, shared), training_of(6, tmp_path)
    again.codebook(6)
    fresh.codebook(6)
    made = [event.stage for event in again.store.events if not event.reused]
    assert made == ["encoder", "codebook"]  # the views are shared
    assert again.made.keys() == fresh.made.keys()
    for key, output in again.made.items():
        assert output.fingerprint == fresh.made[key].fingerprint
    encoders = [np.load(each.encoder().folder / "pca.npz") for each in (again, fresh)]
    for name in encoders[0]:
        np.testing.assert_array_equal(encoders[0][name], encoders[1][name])
    ours, theirs = again.load_codebook(6), fresh.load_codebook(6)
    assert ours.object_id == 6
    for field in dataclasses.fields(ours):
        np.testing.assert_array_equal(getattr(ours, field.name), getattr(theirs, field.name))


def test_views_from_the_store_bear_the_id_that_is_asked_for(shared: Path) -> None:
    assert training_of(1, shared).load_views(1).object_id == 1
    assert training_of(6, shared).load_views(6).object_id == 6
