"""The method's settings: usable alone, equal to what is composed, kept as JSON."""

import json
from dataclasses import asdict, replace

import pytest

from composed_settings import run_settings
from hlp.errors import ConfigError
from hlp.method.settings import MethodSettings
from hlp.models.pca import PcaSettings
from hlp.settings import read_settings


def test_defaults_are_what_hlp_run_composes_for_any_data():
    assert MethodSettings() == run_settings("data=bop", "data.root=folder").method


def test_linemod_differs_in_its_range_of_poses_alone():
    linemod = run_settings("experiment=linemod_bop", "data.root=lm").method
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
    settings = run_settings(*overrides).method
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
