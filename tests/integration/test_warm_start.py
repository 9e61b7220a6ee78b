"""Objects added to those of an earlier run: nothing is learnt from nothing again."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from hlp.method.learn.model_files import read_history, read_weights
from hlp.models.network_training import HolisticCNN
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages
from hlp.stages.warm_start import WarmStartSettings

pytestmark = [pytest.mark.slow, pytest.mark.thorough]


@pytest.fixture
def run(tiny_run, tmp_path):
    shutil.copytree(tiny_run.folder / "work" / "views", tmp_path / "work" / "views")
    return tiny_run.build(f"work={tmp_path / 'work'}")


def training_of(run, left_out=None, manifest=None):
    """Learns all objects but one, or all from what a manifest names."""
    models = {i: model for i, model in run.dataset.models.items() if i != left_out}
    dataset = dataclasses.replace(run.dataset, models=models, target_ids=tuple(models))
    settings = WarmStartSettings(None if manifest is None else str(manifest), 1)
    store = StageStore(Path(run.settings.work))
    return TrainingStages(dataset, run.settings.method, store, settings)


def manifest_of(training, path):
    stages = [dataclasses.asdict(event) for event in training.store.events]
    path.write_text(json.dumps({"config": {}, "stages": stages}))
    return path


@pytest.fixture
def earlier(run):
    """Has learnt all objects but the third."""
    training = training_of(run, left_out=sorted(run.dataset.models)[2])
    training.classifier()
    for object_id in training.dataset.models:
        training.codebook(object_id)
    return training


def test_an_added_object_costs_its_codebook_and_a_short_training(run, earlier, tmp_path):
    added = sorted(run.dataset.models)[2]
    now = training_of(run, manifest=manifest_of(earlier, tmp_path / "manifest.json"))
    assert now.encoder() == earlier.encoder()
    for object_id in run.dataset.models:
        now.codebook(object_id)
        assert object_id == added or now.codebook(object_id) == earlier.codebook(object_id)
    assert np.isfinite(now.load_codebook(added).features).all()
    now.classifier()
    made = [(event.stage, event.of) for event in now.store.events if not event.reused]
    assert made == [("codebook", run.dataset.models[added].name), ("classifier", "")]
    assert now.classifier().fingerprint != earlier.classifier().fingerprint
    assert len(read_history(now.classifier().folder)) == 1
    # Near the earlier weights, class for class, and with one class more.
    before = read_weights(earlier.classifier().folder)
    after = read_weights(now.classifier().folder)
    last = list(before)[-2]
    assert len(after[last]) == len(before[last]) + 1
    kept = torch.cat([after[last][:3], after[last][4:]])
    own = run.settings.classifier
    untrained = HolisticCNN(4, len(after[last]), own.widths, own.hidden, own.dropout)
    start = untrained.state_dict()[last]
    assert (kept - before[last]).abs().mean() < 0.3 * (kept - start[: len(kept)]).abs().mean()


def test_what_cannot_be_gone_on_from_is_named(run, earlier, tmp_path):
    manifest = manifest_of(earlier, tmp_path / "manifest.json")
    fewer = training_of(run, left_out=min(run.dataset.models), manifest=manifest)
    with pytest.raises(ValueError, match="knows objects that this run does not"):
        fewer.classifier()
    other = training_of(run, manifest=manifest)
    local = dataclasses.replace(run.settings.patches.local, size_scale=1.1)
    patches = dataclasses.replace(run.settings.patches, local=local)
    other.settings = dataclasses.replace(other.settings, patches=patches)
    with pytest.raises(ValueError, match="has other settings: local"):
        other.encoder()
    shutil.rmtree(earlier.encoder().folder)
    with pytest.raises(FileNotFoundError, match="has no encoder that"):
        training_of(run, manifest=manifest).encoder()
    with pytest.raises(FileNotFoundError, match="there is no file"):
        training_of(run, manifest=tmp_path / "other.json").classifier()
