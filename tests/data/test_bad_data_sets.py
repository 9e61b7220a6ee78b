"""Data sets in BOP's layout: targets, scenes, models_info.json."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from bad_input import DEEP, Case, check, of_file, written
from hlp.data.bop_models import load_object_models
from hlp.data.bop_scenes import list_scenes
from hlp.data.bop_targets import list_targets
from hlp.objects.object_model import ObjectSettings

BOX = trimesh.creation.box((70, 80, 90))


def targets(text: str) -> Any:
    return of_file(lambda path: list_targets({}, path), "targets.json", text)


ROW = {"scene_id": 1, "im_id": 2, "obj_id": 3, "inst_count": 1}
TARGETS: dict[str, Case] = {
    "targets: an object": (targets('{"6": [1, 2]}'), "it must be a list"),
    "targets: null": (targets("null"), "the content is null: it must be a list"),
    "targets: a number": (targets("7"), "the content is 7"),
    "targets: lists": (targets("[[1, 2]]"), "0 is [1, 2]: it must be an object"),
    "targets: null row": (targets("[null]"), "0 is null: it must be an object"),
    "targets: deep": (targets(DEEP), "nested deeper"),
    "targets: one object twice": (targets(json.dumps([ROW, ROW])), "lists object 3"),
    "targets: no scene": (targets('[{"im_id": 1}]'), "0.scene_id is missing"),
    "targets: no image": (targets('[{"scene_id": 1}]'), "0.im_id is missing"),
}
for _key in ROW:
    for _value, _said in (("1", "'1'"), (1.5, "1.5"), (-1, "-1"), (True, "True"), ([1], "[1]")):
        _name = f"targets: {_key} {_value!r}"
        TARGETS[_name] = (targets(json.dumps([{**ROW, _key: _value}])), f"0.{_key} is {_said}")
TARGETS["targets: no instance"] = (
    targets(json.dumps([{**ROW, "inst_count": 0}])),
    "inst_count is 0: it must be greater than or equal to 1",
)


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
QUARTER = [0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
MODELS: dict[str, Case] = {
    "models_info: a list": (models("[1]"), "the content is [1]: it must be an object"),
    "models_info: deep": (models(DEEP), "nested deeper"),
    "models_info: no JSON": (models("?"), "is no JSON"),
    "models_info: null": (models(None), "1 is null: it must be an object"),
    "models_info: metres": (models({"diameter": 0.1393}), "must be in millimetres"),
    "models_info: tenth": (models({"diameter": 13.93}), "the mesh's is 139.2"),
    "models_info: another mesh": (models({"diameter": 300.0}), "diameter is 300"),
    "models_info: no size": (models({"diameter": 0}), "1.diameter is 0"),
    "models_info: below 0": (models({"diameter": -1.0}), "1.diameter is -1.0"),
    "models_info: NaN": (models('{"1": {"diameter": NaN}}'), "1.diameter is nan"),
    "models_info: infinity": (models('{"1": {"diameter": Infinity}}'), "1.diameter is inf"),
    "models_info: text": (models({"diameter": "139"}), "1.diameter is '139': it must be a number"),
    "models_info: true": (models({"diameter": True}), "1.diameter is True"),
    "symmetries: null": (models({"symmetries_discrete": None}), "is null: it must be a list"),
    "symmetries: an object": (models({"symmetries_discrete": {}}), "it must be a list"),
    "symmetries: 15 numbers": (
        models({"symmetries_discrete": [HALF_TURN[:15]]}),
        "symmetries_discrete.0 has 15 numbers, it must have 16",
    ),
    "symmetries: text": (models({"symmetries_discrete": [["a"] * 16]}), "is 'a': it must be a num"),
    "symmetries: a reflection": (
        models({"symmetries_discrete": [np.diag([-1.0, 1, 1, 1]).ravel().tolist()]}),
        "symmetries_discrete.0 is no rotation but a reflection",
    ),
    "symmetries: scaled": (
        models({"symmetries_discrete": [np.diag([2.0, 2, 2, 1]).ravel().tolist()]}),
        "symmetries_discrete.0 is no rotation",
    ),
    "symmetries: columns": (
        models({"symmetries_discrete": [[*HALF_TURN[:12], 5.0, 0.0, 0.0, 1.0]]}),
        "its last row is [5.0, 0.0, 0.0, 1.0]",
    ),
    "symmetries: far away": (
        models({"symmetries_discrete": [[*HALF_TURN[:3], 90.0, *HALF_TURN[4:]]]}),
        "a turn by 180°",
    ),
    "symmetries: in metres": (models(turned([0, 0, 1], [0.5, 90.0, 0])), "stated symmetry"),
    "symmetries: no turn of a box": (models(turned([1, 1, 0], [0, 0, 0])), "from itself"),
    "symmetries: no axis": (
        models({"symmetries_continuous": [{"offset": [0, 0, 0]}]}),
        "1.symmetries_continuous.0.axis is missing",
    ),
    "symmetries: no offset": (
        models({"symmetries_continuous": [{"axis": [0, 0, 1]}]}),
        "offset is missing",
    ),
    "symmetries: null axis": (
        models({"symmetries_continuous": [{"axis": None, "offset": [0, 0, 0]}]}),
        "axis is null: it must be a list",
    ),
    "symmetries: axis of length 0": (models(turned([0, 0, 0], [0, 0, 0])), "positive length"),
    "symmetries: short axis": (models(turned([0, 1], [0, 0, 0])), "axis has 2 numbers, it must"),
    "symmetries: too many": (
        models({"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}] * 40}, 315),
        "12600 motions",
    ),
}


def two_folders(folder: Path) -> object:
    (folder / "6").mkdir()
    (folder / "000006").mkdir()
    return list_scenes(folder)


SCENES: dict[str, Case] = {
    "no split": (lambda folder: list_scenes(folder / "test"), "no folder"),
    "two folders of a scene": (two_folders, "two folders of scene 6"),
    "no scene": (list_scenes, "no scene in"),
}
for _text, _said in (
    ("[]", "must be an object"),
    ("null", "must be an object"),
    ('{"a": {}}', "the key 'a' is no id"),
    ('{"-1": {}}', "the key '-1' is no id"),
    ('{"01": {}}', "the key '01' is no id"),
    ('{"1.5": {}}', "the key '1.5' is no id"),
    (DEEP, "nested deeper"),
):

    def _frames(folder: Path, text: str = _text) -> object:
        written(folder / "000001" / "scene_camera.json", text)
        return list_scenes(folder)[1].frame_ids

    SCENES[f"scene_camera: {_text[:9]}"] = (_frames, _said)

CASES = {**TARGETS, **MODELS, **SCENES}


@pytest.mark.usefixtures("no_near_symmetries")
@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(CASES[case], tmp_path)


def test_no_case_is_lost() -> None:
    assert len(CASES) >= 68
