import dataclasses

import numpy as np
import pytest
import trimesh

from hlp.errors import ConfigError
from hlp.objects.object_model import (
    ObjectSettings,
    build_object_model,
    check_unique,
    holistic_size,
    local_size,
    model_identity,
)


@pytest.fixture
def mesh_path(tmp_path):
    path = tmp_path / "obj_000004.ply"
    path.write_bytes(trimesh.creation.box((100, 60, 80)).subdivide().export(file_type="ply"))
    return path


def _build(path, holistic=None, local=None, **more):
    return build_object_model(
        "cam", ObjectSettings(4, holistic, local), path, 0.001, proxy_faces=12, **more
    )


def test_sizes_given_in_millimetres_win(mesh_path):
    model = _build(mesh_path, 150.0, 40.0)
    assert (model.object_id, model.name) == (4, "cam")
    assert model.holistic_size == pytest.approx(0.15)
    assert model.local_size == pytest.approx(0.04)


def test_sizes_not_given_follow_the_rules(mesh_path):
    model = _build(mesh_path)
    diameter = np.sqrt(0.1**2 + 0.06**2 + 0.08**2)
    assert model.diameter == pytest.approx(diameter)
    assert model.holistic_size == holistic_size(model.mesh.vertices) == 0.09
    assert model.local_size == local_size(diameter)


def test_a_listed_diameter_and_symmetries_win(mesh_path):
    symmetries = np.stack([np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])])
    model = _build(mesh_path, diameter=0.2, symmetries=symmetries)
    assert model.diameter == 0.2
    assert model.local_size == local_size(0.2)
    np.testing.assert_array_equal(model.symmetries, symmetries)
    assert len(model.siblings) == 0


def test_symmetries_not_given_are_found_in_the_shape(mesh_path):
    assert len(_build(mesh_path).symmetries) == 4


def test_the_proxy_is_the_decimated_mesh(mesh_path):
    model = _build(mesh_path)
    assert len(model.mesh.faces) == 48
    assert len(model.proxy.faces) <= 12


@pytest.mark.parametrize(
    ("sizes", "key"), [((0.0, 40.0), "holistic_size_mm"), ((80.0, -1.0), "local_size_mm")]
)
def test_a_size_that_is_not_positive_is_named(mesh_path, sizes, key):
    with pytest.raises(ConfigError, match=f"{key} is .*: it must be above 0"):
        _build(mesh_path, *sizes)


def test_two_objects_of_one_id_and_none_at_all_are_refused():
    with pytest.raises(ValueError, match="cam and can"):
        check_unique({"cam": ObjectSettings(4, None, None), "can": ObjectSettings(4, 1.0, 1.0)})
    with pytest.raises(ValueError, match="no object"):
        check_unique({})


def test_identity_follows_geometry_but_not_patch_sizes(mesh_path):
    model = _build(mesh_path)
    assert model_identity(model) == model_identity(_build(mesh_path, 150.0, 40.0))
    vertices = model.mesh.vertices.copy()
    vertices[0, 0] += 1e-6
    colors = model.mesh.colors.copy()
    colors[0, 0] ^= 1
    changed = [
        dataclasses.replace(model, mesh=dataclasses.replace(model.mesh, vertices=vertices)),
        dataclasses.replace(model, mesh=dataclasses.replace(model.mesh, colors=colors)),
        dataclasses.replace(model, proxy=model.mesh),
        dataclasses.replace(model, diameter=0.15),
    ]
    assert len({model_identity(item) for item in [model, *changed]}) == 5
