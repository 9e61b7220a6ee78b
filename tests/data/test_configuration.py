from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from hlp.data.bop import BopSettings
from hlp.data.linemod import LinemodSettings
from hlp.evaluation.settings import EvaluationSettings
from hlp.settings import read_settings

CONF = Path(__file__).parents[2] / "conf"


def _compose(group, alternative, *overrides):
    with initialize_config_dir(str(CONF), version_base="1.3"):
        config = compose(f"{group}/{alternative}", overrides=list(overrides))
    return config[group]


def _typed(settings, node):
    values = OmegaConf.to_container(node, resolve=True, throw_on_missing=True)
    return read_settings(settings, values)


def test_the_board_becomes_typed_settings():
    settings = _typed(BopSettings, _compose("data", "linemod_bop", "data.root=lm"))
    assert settings.name == "bop"
    assert settings.photographs == "lm/../photos"
    assert len(settings.objects) == 15
    assert settings.objects["ape"].id == 1
    assert settings.objects["driller"].holistic_size_mm == 200.0
    assert settings.symmetry_steps > 72  # coarser steps alone would cost more than 2.5 degrees


def test_an_objects_size_can_be_swept_and_an_object_left_out():
    overrides = ["data.root=lm", "data.objects.cat.local_size_mm=60", "~data.objects.ape"]
    settings = _typed(BopSettings, _compose("data", "linemod_bop", *overrides))
    assert settings.objects["cat"].local_size_mm == 60.0
    assert "ape" not in settings.objects


def test_linemods_first_layout_becomes_typed_settings():
    settings = _typed(LinemodSettings, _compose("data", "linemod", "data.root=lm"))
    assert settings.name == "linemod" and len(settings.objects) == 15
    assert settings.camera_matrix[:3] == pytest.approx([572.4114, 0, 325.2611])


@pytest.mark.parametrize(
    ("policy", "symmetric"),
    [("bop", ["bowl", "cup", "eggbox", "glue"]), ("eggbox_glue", ["eggbox", "glue"])],
)
def test_policies_of_evaluation_become_typed_settings(policy, symmetric):
    settings = _typed(EvaluationSettings, _compose("evaluation", policy))
    assert (settings.name, settings.symmetric) == (policy, tuple(symmetric))
    assert (settings.add_fraction, settings.translation_cm, settings.rotation_deg) == (0.1, 5, 5)
    assert settings.iou == 0.5
