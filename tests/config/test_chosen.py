import pytest
from omegaconf import OmegaConf

from hlp.commands.composing import compose_config
from hlp.config.composition import groups_of, overrides_of


def test_overrides_as_text_by_key() -> None:
    given = ["+refinement.particles=25", "encoder=pca", "data.objects=[5,5]", "~voting", "seed=1,2"]
    assert overrides_of(given) == {
        "refinement.particles": "25",
        "encoder": "pca",
        "data.objects": "[5,5]",
    }


def test_where_a_run_is_stored_is_nothing_that_it_was_given() -> None:
    places = ["work=there", "output=here", "experiment=fig9b", "data_folder=../data"]
    groups = ["hydra/launcher=cores", "hydra.sweep.dir=x", "reporting=none", "reporting.uri=y"]
    assert overrides_of([*places, *groups, "seed=1", "workers=2"]) == {"seed": "1", "workers": "2"}


def test_groups_without_hydras_own() -> None:
    choices = {"refinement": "icp", "hydra/launcher": "basic", "data/sizes@_global_": "demo"}
    hydra = OmegaConf.create({"runtime": {"choices": choices}})
    assert groups_of(hydra) == {"refinement": "icp"}


def test_mlflow_follows_its_own_variable_and_the_work_folder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    own = compose_config("work=there", "experiment=fig9b").reporting
    assert (own.uri, own.experiment) == ("sqlite:///there/mlflow.db", "fig9b")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://server:5000")
    assert compose_config().reporting.uri == "http://server:5000"
    assert compose_config("reporting=none").reporting.name == "none"
