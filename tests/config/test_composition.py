"""The settings' defaults as Hydra sees them, and YAML files that say no more than they must."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
from hydra.errors import MissingConfigException
from omegaconf import OmegaConf
from typing_extensions import Doc

from hlp.commands.composing import compose_config
from hlp.config.composition import defaults_of, group_kinds, groups_of, overrides_of, rows
from hlp.config.settings import RunSettings
from hlp.refinement.pso import PsoSettings
from hlp.settings import Registry, Settings

CONF = Path(__file__).parents[2] / "conf"


def settings_classes():
    found: list[type] = [RunSettings]
    for kind in group_kinds().values():
        registered = kind.alternatives().values() if isinstance(kind, Registry) else [kind]
        found += [one for one in dict.fromkeys(registered) if one not in found]
    for kind in found:  # grows while it is walked
        for hint in get_type_hints(kind).values():
            parts = [hint, *get_args(hint)]
            inner = [
                part for part in parts if isinstance(part, type) and issubclass(part, Settings)
            ]
            found += [settings for settings in inner if settings not in found]
    return found


@pytest.mark.parametrize("kind", settings_classes(), ids=lambda kind: kind.__name__)
def test_every_field_says_what_it_means(kind):
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if name not in {field.name for field in dataclasses.fields(kind)} - {"name"}:
            continue
        grouped = kind is RunSettings and name in group_kinds()
        nested = isinstance(hint, type) and issubclass(hint, Settings)
        said = [fact.documentation for fact in get_args(hint)[1:] if isinstance(fact, Doc)]
        assert nested or grouped or any(said), f"{kind.__name__}.{name} has no Doc"


def yaml_files():
    """Every alternative with its path and the settings class's name that it is based on."""
    for group in group_kinds():
        for path in sorted((CONF / group).glob("*.yaml")):
            listed = OmegaConf.load(path).get("defaults") or []
            bases = [item for item in listed if isinstance(item, str) and item.startswith("base")]
            if bases:
                yield group, path.stem, bases[0].partition("_")[2] or None


@pytest.mark.parametrize(("group", "stem", "base"), list(yaml_files()))
def test_a_file_says_its_name_and_what_differs(group, stem, base):
    values = OmegaConf.to_container(OmegaConf.load(CONF / group / f"{stem}.yaml"))
    assert isinstance(values, dict) and values.pop("name")
    del values["defaults"]
    kind = group_kinds()[group]
    found = kind.find(base or "") if isinstance(kind, Registry) else kind
    assert list(repeated(values, defaults_of(found, base))) == []


def repeated(values, defaults):
    for key, value in values.items():
        if isinstance(value, Mapping) and isinstance(defaults[key], Mapping) and defaults[key]:
            yield from (f"{key}.{inner}" for inner in repeated(value, defaults[key]))
        elif value == defaults[key] and value != "???":
            yield key


def composed(folder, *overrides):
    return compose_config("output=out", f"hydra.searchpath=[file://{folder}]", *overrides)


def test_a_file_of_ones_own_starts_from_the_defaults(tmp_path):
    (tmp_path / "refinement").mkdir()
    (tmp_path / "refinement" / "mine.yaml").write_text(
        "defaults:\n  - base_pso\n  - _self_\nname: pso\nparticles: 7\n"
    )
    config = composed(tmp_path, "refinement=mine", "refinement.cost.roi_size=32")
    assert config.refinement.particles == 7 and config.refinement.cost.roi_size == 32
    assert config.refinement.iterations == PsoSettings().iterations


@pytest.mark.parametrize("group", sorted({*rows()} & {*group_kinds()}))
def test_a_row_stands_for_the_defaults_of_its_class(group, tmp_path):
    for name, what in rows()[group].items():
        kind = group_kinds()[group]
        found = kind.find(name) if isinstance(kind, Registry) else kind
        given = ["data=bop", "data.root=X"] if group != "data" else []  # the demo changes some
        assert composed(tmp_path, *given, f"{group}={name}")[group] == defaults_of(found, name)
        assert isinstance(what, str) and what.endswith((".", "/"))
        assert not (CONF / group / f"{name}.yaml").exists()


def test_defaults_that_are_not_there_are_no_file(tmp_path):
    for group, base in (("refinement", "base_psi"), ("patches", "base_hlp"), ("voting", "base")):
        (tmp_path / group).mkdir()
        (tmp_path / group / "mine.yaml").write_text(f"defaults:\n  - {base}\nname: pso\n")
        with pytest.raises(MissingConfigException, match=f"{group}/{base}"):
            composed(tmp_path, f"{group}=mine")


def test_overrides_as_text_by_key():
    given = ["+refinement.particles=25", "encoder=pca", "data.objects=[5,5]", "~voting", "seed=1,2"]
    assert overrides_of(given) == {
        "refinement.particles": "25",
        "encoder": "pca",
        "data.objects": "[5,5]",
    }


def test_where_a_run_is_stored_is_nothing_that_it_was_given():
    places = ["work=there", "output=here", "experiment=fig9b", "data_folder=../data"]
    groups = ["hydra/launcher=cores", "hydra.sweep.dir=x", "reporting=none", "reporting.uri=y"]
    assert overrides_of([*places, *groups, "seed=1", "workers=2"]) == {"seed": "1", "workers": "2"}


def test_groups_without_hydras_own():
    choices = {"refinement": "icp", "hydra/launcher": "basic", "data/sizes@_global_": "demo"}
    hydra = OmegaConf.create({"runtime": {"choices": choices}})
    assert groups_of(hydra) == {"refinement": "icp"}


def test_mlflow_follows_its_own_variable_and_the_work_folder(monkeypatch):
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    own = compose_config("work=there", "experiment=fig9b").reporting
    assert (own.uri, own.experiment) == ("sqlite:///there/mlflow.db", "fig9b")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://server:5000")
    assert compose_config().reporting.uri == "http://server:5000"
    assert compose_config("reporting=none").reporting.name == "none"
