"""Objects added to those of an earlier run: nothing is learnt from nothing again."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir

from hlp.commands.composing import config_folder
from hlp.models.classifier import HolisticCNN
from hlp.pipeline.build import Run, build_run
from hlp.pipeline.learning import Learner
from hlp.pipeline.settings import ExtendSettings
from hlp.pipeline.store import StageStore
from hlp.pipeline.training import read_history, read_weights
from tiny_run import TinyRun


@pytest.fixture
def planned(tiny_run: TinyRun, tmp_path: Path) -> Run:
    shutil.copytree(tiny_run.folder / "work" / "views", tmp_path / "work" / "views")
    given = (*tiny_run.overrides, f"work={tmp_path / 'work'}", "output=out")
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        return build_run(compose("config", overrides=list(given)))


def learner_of(planned: Run, left_out: int | None = None, manifest: Path | None = None) -> Learner:
    """Learns all objects but one, or all from what a manifest names."""
    models = {i: model for i, model in planned.world.models.items() if i != left_out}
    world = dataclasses.replace(planned.world, models=models, target_ids=tuple(models))
    extend = ExtendSettings(None if manifest is None else str(manifest), 1)
    settings = dataclasses.replace(planned.settings, extend=extend)
    return Learner(world, settings, StageStore(Path(settings.work)))


def manifest_of(learner: Learner, path: Path) -> Path:
    stages = [dataclasses.asdict(event) for event in learner.store.events]
    path.write_text(json.dumps({"config": {}, "stages": stages}))
    return path


@pytest.fixture
def earlier(planned: Run) -> Learner:
    """Has learnt all objects but the third."""
    learner = learner_of(planned, left_out=sorted(planned.world.models)[2])
    learner.classifier()
    for object_id in learner.world.models:
        learner.codebook(object_id)
    return learner


def test_an_added_object_costs_its_codebook_and_a_short_training(
    planned: Run, earlier: Learner, tmp_path: Path
) -> None:
    added = sorted(planned.world.models)[2]
    now = learner_of(planned, manifest=manifest_of(earlier, tmp_path / "manifest.json"))
    assert now.encoder() == earlier.encoder()
    for object_id in planned.world.models:
        now.codebook(object_id)
    now.classifier()
    made = [(event.stage, event.of) for event in now.store.events if not event.reused]
    assert made == [("codebook", planned.world.models[added].name), ("classifier", "")]
    assert now.classifier().fingerprint != earlier.classifier().fingerprint
    assert len(read_history(now.classifier().folder)) == 1
    # Near the earlier weights, class for class, and with one class more.
    before = read_weights(earlier.classifier().folder)
    after = read_weights(now.classifier().folder)
    last = list(before)[-2]
    assert len(after[last]) == len(before[last]) + 1
    kept = torch.cat([after[last][:3], after[last][4:]])
    start = HolisticCNN(4, len(after[last]), *_sizes(planned)).state_dict()[last]
    assert (kept - before[last]).abs().mean() < 0.3 * (kept - start[: len(kept)]).abs().mean()


def _sizes(planned: Run) -> tuple[tuple[int, ...], int, float]:
    classifier = planned.settings.classifier
    return classifier.widths, classifier.hidden, classifier.dropout


def test_what_cannot_be_gone_on_from_is_named(
    planned: Run, earlier: Learner, tmp_path: Path
) -> None:
    manifest = manifest_of(earlier, tmp_path / "manifest.json")
    fewer = learner_of(planned, left_out=min(planned.world.models), manifest=manifest)
    with pytest.raises(ValueError, match="knows objects that this run has not"):
        fewer.classifier()
    other = learner_of(planned, manifest=manifest)
    local = dataclasses.replace(planned.settings.patches.local, size_scale=1.1)
    patches = dataclasses.replace(planned.settings.patches, local=local)
    other.settings = dataclasses.replace(other.settings, patches=patches)
    with pytest.raises(ValueError, match="has other settings: local"):
        other.encoder()
    shutil.rmtree(earlier.encoder().folder)
    with pytest.raises(FileNotFoundError, match="no encoder of"):
        learner_of(planned, manifest=manifest).encoder()
    with pytest.raises(FileNotFoundError, match="no manifest"):
        learner_of(planned, manifest=tmp_path / "other.json").classifier()


def test_features_of_the_objects_before_stay_as_they_are(
    planned: Run, earlier: Learner, tmp_path: Path
) -> None:
    now = learner_of(planned, manifest=manifest_of(earlier, tmp_path / "manifest.json"))
    for object_id in earlier.world.models:
        assert now.codebook(object_id) == earlier.codebook(object_id)
        assert np.isfinite(now.load_codebook(object_id).features).all()
