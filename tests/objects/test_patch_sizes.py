import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from hlp.objects.meshes import load_mesh
from hlp.objects.object_model import holistic_size, local_size

OBJECTS = Path(__file__).parents[2] / "conf" / "data" / "objects" / "linemod.yaml"

# Extents and diameters (m) that BOP lists for LINEMOD.
APE, DRILLER, BOWL = (0.0759, 0.0776, 0.0918), (0.2295, 0.0755, 0.2080), (0.1664, 0.1653, 0.0745)


def _box(extents):
    return np.array([np.zeros(3), extents]) + 0.3


@pytest.mark.parametrize(("extents", "printed"), [(APE, 0.08), (DRILLER, 0.20), (BOWL, 0.18)])
def test_the_holistic_rule_gives_the_sizes_that_the_paper_prints(extents, printed):
    assert holistic_size(_box(extents)) == printed


@pytest.mark.parametrize(("diameter", "printed"), [(0.1021, 0.03), (0.1725, 0.04), (0.2615, 0.08)])
def test_the_local_rule_gives_the_sizes_that_the_paper_prints(diameter, printed):
    assert local_size(diameter) == printed


def test_sizes_end_where_the_printed_ones_do():
    assert holistic_size(_box((0.5, 0.6, 0.7))) == 0.20
    assert local_size(0.05) == 0.03
    assert local_size(0.5) == 0.08
    assert local_size((0.102 + 0.172) / 2) == 0.035


def test_the_configuration_holds_what_the_rules_give(shared_data):
    info = json.loads((shared_data / "lm/models/models_info.json").read_text())
    objects = yaml.safe_load(OBJECTS.read_text())
    assert [entry["id"] for entry in objects.values()] == list(range(1, 16))
    for name, entry in objects.items():
        file = f"obj_{entry['id']:06d}.ply"
        path = shared_data / "lm/models" / file
        mesh = load_mesh(path if path.is_file() else shared_data / "lm/models_eval" / file)
        holistic = round(holistic_size(mesh.vertices) * 1000)
        local = round(local_size(info[str(entry["id"])]["diameter"] / 1000) * 1000)
        assert (entry["holistic_size_mm"], entry["local_size_mm"]) == (holistic, local), name
