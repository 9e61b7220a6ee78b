"""Object models of BOP data sets: meshes, diameters, symmetries."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from bad_input import Case, check, written
from hlp.data.bop_models import load_object_models, symmetry_motions
from hlp.objects.mesh_colors import PLAIN_COLOR
from hlp.objects.object_model import ObjectSettings
from hlp.schemas import ModelInfo
from hlp.settings import read_settings

APE, BOWL = ObjectSettings(1, 80.0, 30.0), ObjectSettings(3, None, None)


@pytest.fixture
def root(tmp_path):
    box = trimesh.creation.box((70, 80, 90))
    colors = np.full((8, 3), [150, 60, 50], np.uint8)
    painted = trimesh.Trimesh(box.vertices, box.faces, vertex_colors=colors)
    for folder in ("models", "models_eval"):
        (tmp_path / folder).mkdir()
        info = {"1": {"diameter": 139.5}, "3": {"diameter": 139.6}}
        (tmp_path / folder / "models_info.json").write_text(json.dumps(info))
    (tmp_path / "models" / "obj_000001.ply").write_bytes(painted.export(file_type="ply"))
    (tmp_path / "models_eval" / "obj_000001.ply").write_bytes(box.export(file_type="ply"))
    (tmp_path / "models_eval" / "obj_000003.ply").write_bytes(box.export(file_type="ply"))
    return tmp_path


@pytest.mark.usefixtures("no_near_symmetries")
def test_colours_come_from_models_and_what_is_missing_there_from_models_eval(root):
    models = load_object_models(root, {"ape": APE, "bowl": BOWL}, 2000, 36)
    assert [(key, model.name) for key, model in models.items()] == [(1, "ape"), (3, "bowl")]
    assert models[1].mesh.colors[0].tolist() == [150, 60, 50]
    assert models[3].mesh.colors[0].tolist() == list(PLAIN_COLOR)
    assert models[1].diameter == pytest.approx(0.1395)
    assert models[1].mesh.vertices.max() == pytest.approx(0.045)


@pytest.mark.usefixtures("no_near_symmetries")
def test_without_a_list_the_diameter_is_measured(root):
    (root / "models" / "models_info.json").unlink()
    model = load_object_models(root, {"ape": APE}, 2000, 36)[1]
    assert model.diameter == pytest.approx(np.sqrt(0.07**2 + 0.08**2 + 0.09**2))


@pytest.mark.parametrize("states", [False, True])
def test_a_list_that_states_no_symmetry_at_all_leaves_them_to_the_mesh(root, states):
    info = {"1": {"diameter": 139.5}, "9": {"diameter": 50.0}}
    if states:
        info["9"]["symmetries_discrete"] = [np.diag([-1, -1, 1, 1]).reshape(-1).tolist()]
    (root / "models" / "models_info.json").write_text(json.dumps(info))
    model = load_object_models(root, {"ape": APE}, 2000, 36)[1]
    assert len(model.symmetries) == (1 if states else 4)
    assert len(model.near_symmetries) == (3 if states else 0)


def test_a_discrete_symmetry_gets_a_true_rotation_and_metres():
    flip = np.diag([-1.0, -1.0, 1.0, 1.0])
    flip[:3, 3] = [4.0, 0.0, -2.0]
    rounded = flip.copy()
    rounded[0, 1] = 0.003
    motions = symmetry_motions(ModelInfo(symmetries_discrete=(tuple(rounded.ravel()),)), 36)
    assert motions.shape == (2, 4, 4)
    np.testing.assert_array_equal(motions[0], np.eye(4))
    np.testing.assert_allclose(motions[1, :3, :3] @ motions[1, :3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(motions[1, :3, 3], [0.004, 0.0, -0.002])
    np.testing.assert_allclose(motions[1, :3, :3], flip[:3, :3], atol=0.002)


def _toolkit_motions(info, steps):
    """The BOP toolkit's rule: all turns about all axes in one set, each with each discrete one."""
    discrete = [np.eye(4), *(np.reshape(motion, (4, 4)) for motion in info["symmetries_discrete"])]
    turns = []
    for entry in info["symmetries_continuous"]:
        offset = np.array(entry["offset"])
        for i in range(steps):
            turn = np.eye(4)
            vector = np.array(entry["axis"]) / np.linalg.norm(entry["axis"]) * i * 2 * np.pi / steps
            turn[:3, :3] = Rotation.from_rotvec(vector).as_matrix()
            turn[:3, 3] = offset - turn[:3, :3] @ offset
            turns.append(turn)
    motions = np.array([turn @ motion for motion in discrete for turn in turns])
    motions[:, :3, 3] *= 1e-3
    return motions


def test_several_axes_join_and_combine_with_the_discrete_ones_as_in_the_toolkit():
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    flip[:3, 3] = [1.0, 2.0, 3.0]
    info = {
        "symmetries_discrete": [flip.ravel().tolist()],
        "symmetries_continuous": [
            {"axis": [0, 0, 1], "offset": [1, 2, 0]},
            {"axis": [2, 0, 0], "offset": [0, 5, 0]},
            {"axis": [1, 1, 0], "offset": [0, 0, 0]},
        ],
    }
    motions = symmetry_motions(read_settings(ModelInfo, info), 6)
    np.testing.assert_allclose(motions, _toolkit_motions(info, 6), atol=1e-12)
    assert len(motions) == 2 * 3 * 6
    np.testing.assert_allclose(motions[0], np.eye(4), atol=1e-12)


@pytest.mark.usefixtures("no_near_symmetries")
def test_symmetries_of_linemod_are_read_and_found_to_be_some(shared_data):
    objects = {"bowl": BOWL, "eggbox": ObjectSettings(10, None, None)}
    models = load_object_models(shared_data / "lm", objects, 2000, 12)
    assert {key: len(model.symmetries) for key, model in models.items()} == {3: 12, 10: 2}


BOX = trimesh.creation.box((70, 80, 90))


def models(info: Any, steps: int = 8) -> Any:
    """A data set of one box with this entry in models_info.json, or this text of it."""

    def read(folder: Path) -> object:
        text = info if isinstance(info, str) else json.dumps({"1": info})
        written(folder / "models" / "models_info.json", text)
        written(folder / "models" / "obj_000001.ply", BOX.export(file_type="ply"))
        return load_object_models(folder, {"box": ObjectSettings(1)}, 500, steps)

    return read


def turned(axis: list[float], offset: list[float]) -> Any:
    return {"diameter": 139.3, "symmetries_continuous": [{"axis": axis, "offset": offset}]}


HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0]).ravel().tolist()
MODELS: dict[str, Case] = {
    "models_info: a list": (models("[1]"), "the content is [1]: it must be a mapping"),
    "models_info: metres": (models({"diameter": 0.1393}), "must be in millimetres"),
    "models_info: another mesh": (models({"diameter": 300.0}), "diameter is 300"),
    "symmetries: a reflection": (
        models({"symmetries_discrete": [np.diag([-1.0, 1, 1, 1]).ravel().tolist()]}),
        "symmetries_discrete.0 is not a rotation but a reflection",
    ),
    "symmetries: columns": (
        models({"symmetries_discrete": [[*HALF_TURN[:12], 5.0, 0.0, 0.0, 1.0]]}),
        "its last row is [5.0, 0.0, 0.0, 1.0]",
    ),
    "symmetries: far away": (
        models({"symmetries_discrete": [[*HALF_TURN[:3], 90.0, *HALF_TURN[4:]]]}),
        "a turn by 180°",
    ),
    "symmetries: no turn of a box": (models(turned([1, 1, 0], [0, 0, 0])), "from itself"),
    "symmetries: axis of length 0": (models(turned([0, 0, 0], [0, 0, 0])), "positive length"),
    "symmetries: too many": (
        models({"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}] * 40}, 315),
        "12600 motions",
    ),
}


@pytest.mark.usefixtures("no_near_symmetries")
@pytest.mark.parametrize("case", MODELS)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(MODELS[case], tmp_path)
