"""What the names of the stages' outputs depend on. Nothing is made."""

import copy
import dataclasses
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from composed_settings import run_settings
from fake_detection import FakeEstimator, method_settings
from hlp import fingerprints
from hlp.stages import detection
from hlp.stages.detection import DetectionStages
from hlp.stages.store import StageStore
from hlp.stages.training import TrainingStages

CHOICES = (
    (),
    ("encoder=cae", "codebook=kd_forest", "voting=paper", "refinement=icp"),
    ("encoder=pca", "codebook=exact", "refinement=none", "rendering=pyrender", "trainer=gpu"),
)
KEYS = ("000000_000000", "000001_000000")
ALL = {"views", "classifier", "encoder", "codebook", "regions", "hypotheses", "poses"}


class NothingIsMade(StageStore):
    """A store that takes every output for finished."""

    def get_or_make(self, stage, fingerprint, *_, **__):
        return self.root / stage / fingerprint

    @contextmanager
    def open(self, stage, fingerprint, *_, **__):
        yield self.root / stage / fingerprint, True


@pytest.fixture(scope="module", autouse=True)
def fake():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(detection, "PoseEstimator", FakeEstimator)
        yield


@pytest.fixture(scope="module")
def dataset():
    built = run_settings().data.build()
    some = {i: built.models[i] for i in sorted(built.models)[:2]}
    return dataclasses.replace(built, models=some, target_ids=tuple(some))


def names(settings, dataset, keys=KEYS):
    """Fingerprints of all stages' outputs by stage and object."""
    store = NothingIsMade(Path("nowhere"))
    training = TrainingStages(dataset, settings, store)
    stages = DetectionStages(dataset, settings, training, keys)
    stages.make("poses")
    made = {f"{stage} {i}": output.fingerprint for (stage, i), output in training.made.items()}
    return made | {stage: output.fingerprint for stage, output in stages.made.items()}


def changed(before, after):
    """Stages of which any output has another name."""
    assert before.keys() == after.keys()
    return {name.split()[0] for name in before if before[name] != after[name]}


def leaves(settings, prefix=""):
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value):
            yield from leaves(value, f"{prefix}{field.name}.")
        else:
            yield f"{prefix}{field.name}"


def other(value):
    """Another value of the same kind; whether it makes sense does not matter here."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    if isinstance(value, str):
        return f"{value}x"
    if isinstance(value, tuple):
        return (*value, *(value[:1] or (1,)))
    return 1.5


def with_other(settings, key):
    """The settings with another value at a dotted key; nothing checks it."""
    first, _, rest = key.partition(".")
    value = getattr(settings, first)
    one = copy.copy(settings)
    object.__setattr__(one, first, with_other(value, rest) if rest else other(value))
    return one


COARSE = {"hypotheses", "poses"}
RENAMED = {
    "seed": ALL,
    "rendering": ALL,
    "patches.holistic": {"classifier", "regions"} | COARSE,
    "patches.pool": {"classifier", "regions"} | COARSE,
    "classifier": {"classifier", "regions"} | COARSE,
    "trainer": ALL - {"views"},
    "patches.region": {"regions"} | COARSE,
    "patches.closer_look": {"regions"} | COARSE,
    "patches.pairs": {"encoder", "codebook"} | COARSE,
    "patches.local": {"encoder", "codebook"} | COARSE,
    "encoder": {"encoder", "codebook"} | COARSE,
    "patches.entries": {"codebook"} | COARSE,
    "patches.grid": COARSE,
    "codebook": COARSE,
    "voting": COARSE,
    "refinement": {"poses"},
    "patches.templates": {"poses"},
    "machine.device": {"codebook", "regions"} | COARSE,
}
"""Every group of keys of the method, with the stages that read it, and those made from them."""
READ_BY_NONE = {"patches.name", "machine.name", "machine.threads"}
"""Names of choices, whose values say all, and what decides the time alone."""


@pytest.mark.parametrize("choice", CHOICES, ids=str)
def test_each_key_renames_the_stages_that_read_it_and_no_others(choice, dataset):
    settings = method_settings(*choice)
    before = names(settings, dataset)
    found = {
        key: changed(before, names(with_other(settings, key), dataset)) for key in leaves(settings)
    }
    assert len(found) > 60
    for key, stages in found.items():
        groups = [group for group in RENAMED if key == group or key.startswith(f"{group}.")]
        expected = set() if key in READ_BY_NONE else RENAMED[max(groups, key=len)]
        if "encoder=cae" in choice and key.startswith("rendering."):
            expected = expected - {"encoder"}  # which learns from frames, not from views
        assert stages == expected, key


def test_the_data_change_the_names_of_what_is_made_from_them(dataset, tmp_path):
    settings = method_settings()
    before = names(settings, dataset)

    def after(**changes):
        return changed(before, names(settings, dataclasses.replace(dataset, **changes)))

    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((80, 80, 3), np.uint8))
    learnt_by_classifier = {"classifier", "regions", "hypotheses", "poses"}
    assert after(photographs=tmp_path) == learnt_by_classifier
    assert after(background_frames=None) == learnt_by_classifier
    assert after(encoder_frames=None) == set()  # the contrastive encoder takes none
    assert after(frames=dataset.background_frames) == {"regions", "hypotheses", "poses"}
    first = min(dataset.models)
    model = dataset.models[first]
    for change, stages in (
        ({"holistic_size": 0.3}, learnt_by_classifier),
        ({"local_size": 0.3}, {"encoder", "codebook", "hypotheses", "poses"}),
        ({"symmetries": model.symmetries[[0, 0]]}, {"hypotheses", "poses"}),
        ({"name": "other"}, set()),
    ):
        other_model = dataclasses.replace(model, **change)
        assert after(models={**dataset.models, first: other_model}) == stages, change
    colors = 255 - model.mesh.colors
    painted = dataclasses.replace(model, mesh=dataclasses.replace(model.mesh, colors=colors))
    assert after(models={**dataset.models, first: painted}) == ALL
    more = names(settings, dataset, (*KEYS, "000002_000000"))
    assert changed(before, more) == {"regions", "hypotheses", "poses"}


@pytest.fixture
def edit(monkeypatch):
    """Adds a line to a module's source, as far as digests know."""
    read = fingerprints._read
    edited = set()

    def with_a_line_more(name):
        content = read(name)
        return content + b"#\n" if content is not None and name in edited else content

    def forget():
        fingerprints.code_of.cache_clear()
        fingerprints.source_digest.cache_clear()

    def add(module):
        assert read(module) is not None
        edited.add(module)
        forget()

    monkeypatch.setattr(fingerprints, "_read", with_a_line_more)
    yield add
    forget()


@pytest.fixture(scope="module")
def before(dataset):
    """The names before anything is edited."""
    return names(method_settings(), dataset)


FOUND = {"regions", "hypotheses", "poses"}


@pytest.mark.parametrize(
    ("module", "stages"),
    [
        ("hlp.rendering.rasterizer", ALL),
        ("hlp.records", ALL),
        ("hlp.patches.holistic_pool", {"classifier", *FOUND}),
        ("hlp.data.images", {"classifier", *FOUND}),
        ("hlp.rendering.sensor", {"classifier", *FOUND}),
        ("hlp.patches.local_pool", {"encoder", "codebook", "hypotheses", "poses"}),
        ("hlp.method.learn.training", ALL - {"views"}),
        ("hlp.codebook.entries", {"codebook", "hypotheses", "poses"}),
        ("hlp.voting.mean_shift", {"hypotheses", "poses"}),
        ("hlp.refinement.pso", {"poses"}),
        ("hlp.stages.trace_files", FOUND),
        ("hlp.method.settings", set()),
        ("hlp.reporting.table", set()),
        ("hlp.runs.runner", set()),
    ],
)
def test_an_edit_changes_the_names_of_the_stages_that_run_it(module, stages, dataset, before, edit):
    edit(module)
    assert changed(before, names(method_settings(), dataclasses.replace(dataset))) == stages


def test_another_version_of_a_library_changes_the_names_of_the_stages_that_use_it(
    dataset, monkeypatch, edit
):
    before = names(method_settings(), dataset)
    versions = fingerprints._versions

    def newer(modules):
        return {name: f"{v}.1" if name == "torch" else v for name, v in versions(modules).items()}

    monkeypatch.setattr(fingerprints, "_versions", newer)
    edit("hlp.reporting.table")  # clears what was read; changes nothing itself
    assert changed(before, names(method_settings(), dataset)) == ALL - {"views"}
