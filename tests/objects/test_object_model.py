import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from hlp.errors import ConfigError
from hlp.objects.meshes import load_mesh, mesh_diameter
from hlp.objects.object_model import (
    ObjectSettings,
    build_object_model,
    build_proxy,
    chosen_objects,
    holistic_size,
    local_size,
    model_identity,
)
from hlp.records import Texture
from hlp.rendering.rasterizer import render_depth
from refinement_scene import as_mesh


@pytest.fixture
def mesh_path(tmp_path):
    path = tmp_path / "obj_000004.ply"
    path.write_bytes(trimesh.creation.box((100, 60, 80)).subdivide().export(file_type="ply"))
    return path


def _build(path, holistic=None, local=None, **more):
    return build_object_model(
        "cam", ObjectSettings(4, holistic, local), path, 0.001, proxy_faces=12, **more
    )


def test_what_is_not_given_follows_the_rules_and_geometry_makes_the_identity(mesh_path):
    model = _build(mesh_path)
    assert (model.object_id, model.name) == (4, "cam")
    diameter = np.sqrt(0.1**2 + 0.06**2 + 0.08**2)
    assert model.diameter == pytest.approx(diameter)
    assert model.holistic_size == holistic_size(model.mesh.vertices) == 0.09
    assert model.local_size == local_size(diameter)
    assert len(model.symmetries) == 4
    assert len(model.mesh.faces) == 48 and len(model.proxy.faces) <= 12
    sized = _build(mesh_path, 150.0, 40.0)
    assert (sized.holistic_size, sized.local_size) == pytest.approx((0.15, 0.04))
    assert model_identity(model) == model_identity(sized)
    mesh, vertices, colors = model.mesh, model.mesh.vertices.copy(), model.mesh.colors.copy()
    image, uv = np.full((2, 3, 3), 9, np.uint8), np.full((len(vertices), 2), 0.5)
    textures = Texture(image, uv), Texture(255 - image, uv), Texture(image, uv / 2)
    vertices[0, 0] += 1e-6
    colors[0, 0] ^= 1
    changed = [
        replace(model, mesh=replace(mesh, vertices=vertices)),
        replace(model, mesh=replace(mesh, colors=colors)),
        replace(model, proxy=mesh),
        replace(model, mesh=replace(mesh, colored=not mesh.colored)),
        *(replace(model, mesh=replace(mesh, texture=texture)) for texture in textures),
        replace(model, near_symmetries=model.symmetries[1:]),
        replace(model, diameter=0.15),
    ]
    assert len({model_identity(item) for item in [model, *changed]}) == 10


def test_a_listed_diameter_and_symmetries_win(mesh_path):
    symmetries = np.stack([np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])])
    model = _build(mesh_path, diameter=0.2, symmetries=symmetries)
    assert (model.diameter, model.local_size) == (0.2, local_size(0.2))
    np.testing.assert_array_equal(model.symmetries, symmetries)
    assert len(model.near_symmetries) == 0


def test_two_objects_of_one_id_and_none_at_all_are_refused():
    with pytest.raises(ValueError, match="cam and can"):
        chosen_objects({"cam": ObjectSettings(4), "can": ObjectSettings(4)}, None)
    with pytest.raises(ValueError, match="no object"):
        chosen_objects({}, None)
    with pytest.raises(ValueError, match=r"data\.only=\['cup'\] must be some of \['cam'\]"):
        chosen_objects({"cam": ObjectSettings(4)}, ["cup"])


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


def perforated_plate():
    """A plate with many round holes: large flat faces, most triangles on the holes' walls."""
    parts = []
    for x in range(8):
        for y in range(5):
            ring = trimesh.creation.annulus(r_min=0.004, r_max=0.0065, height=0.01, sections=24)
            ring.apply_translation((0.0125 * x, 0.0125 * y, 0.0))
            parts.append(ring)
    return trimesh.util.concatenate(parts)


def silhouettes(mesh, diameter):
    camera = np.array([[1000.0, 0, 60], [0, 1000.0, 60], [0, 0, 1]])
    turn = trimesh.transformations.rotation_matrix
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    poses = []
    for angle in (0.0, 0.5, 1.0):
        pose = turn(angle, [1, 0.3, 0])
        pose[:3, 3] = [0, 0, 10 * diameter] - pose[:3, :3] @ middle
        poses.append(pose)
    return render_depth(mesh, np.array(poses), camera, (120, 120)) > 0


def test_a_part_of_many_small_features_keeps_them():
    mesh = as_mesh(perforated_plate())
    diameter = mesh_diameter(mesh.vertices)
    proxy = build_proxy(mesh, 200, diameter)
    assert 200 < len(proxy.faces) < len(mesh.faces)
    full, drawn = silhouettes(mesh, diameter), silhouettes(proxy, diameter)
    assert (full & drawn).sum() > 0.85 * (full | drawn).sum()


def test_a_smooth_surface_and_flat_faces_without_colours_need_few_triangles():
    """A box that a CAD program divided finely; with colours it keeps the triangles asked for."""
    ball = as_mesh(trimesh.creation.icosphere(subdivisions=4, radius=0.05))
    box = as_mesh(trimesh.creation.box((0.1, 0.05, 0.02)).subdivide_to_size(0.004))
    plain = replace(box, colored=False)
    proxy = build_proxy(plain, 500, 0.114)
    assert len(proxy.faces) <= 15 < 480 < len(build_proxy(box, 500, 0.114).faces) <= 500
    assert len(build_proxy(ball, 500, 0.1).faces) <= 500
    np.testing.assert_array_equal(silhouettes(proxy, 0.114), silhouettes(plain, 0.114))


def test_a_mesh_of_few_triangles_stays_and_too_few_are_refused():
    mesh = as_mesh(trimesh.creation.box((0.1, 0.05, 0.02)))
    assert build_proxy(mesh, 500, 0.12) is mesh
    with pytest.raises(ConfigError, match="at least 4 faces"):
        build_proxy(mesh, 3, 0.12)
