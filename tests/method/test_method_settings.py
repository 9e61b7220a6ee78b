"""The method's settings: usable alone, equal to what is composed, kept as JSON."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir

from hlp.config.build import build_settings
from hlp.errors import ConfigError
from hlp.method.settings import MethodSettings
from hlp.models.pca import PcaSettings
from hlp.settings import read_settings

CONF = Path(__file__).parents[2] / "conf"


def composed(*overrides):
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return build_settings(compose("config", overrides=["output=out", *overrides])).method


def test_defaults_are_what_hlp_run_composes_for_any_data():
    assert MethodSettings() == composed("data=bop", "data.root=folder")


def test_linemod_differs_in_its_range_of_poses_alone():
    linemod = composed("experiment=linemod_bop", "data.root=lm")
    assert linemod.rendering.coverage == "hemisphere"
    assert replace(linemod, rendering=MethodSettings().rendering) == MethodSettings()


@pytest.mark.parametrize(
    "overrides",
    [
        (),
        ("method=paper",),
        ("method=paper_literal",),
        ("encoder=pca", "codebook=exact", "refinement=icp", "machine.threads=1"),
        ("refinement=none", "voting=paper", "rendering=pyrender", "trainer=ddp"),
    ],
)
def test_they_come_back_from_json(overrides):
    settings = composed(*overrides)
    assert read_settings(MethodSettings, json.loads(json.dumps(asdict(settings)))) == settings


def test_what_does_not_go_together_is_refused():
    settings = MethodSettings()
    with pytest.raises(ConfigError, match=r"^encoder\.dimension is 150: .* multiples of 4$"):
        replace(settings, encoder=replace(settings.encoder, dimension=150))
    with pytest.raises(ConfigError, match=r"^encoder\.dimension is 433: .* have 432 components$"):
        values = asdict(settings) | {"encoder": {"name": "pca", "dimension": 433}}
        read_settings(MethodSettings, values)
    local = replace(settings.patches.local, resolution=48)
    with pytest.raises(ConfigError, match=r"^patches\.local\.resolution is 48: .* take 32$"):
        replace(settings, patches=replace(settings.patches, local=local))
    assert replace(settings, encoder=PcaSettings(dimension=432)).encoder.dimension == 432
