"""Warnings of objects that will be hard to find, and none for others."""

import logging
import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hlp.data.synthetic.objects import demo_objects, shape_model
from hlp.method.learn.mesh_models import MeshChoices, build_models, hard_parts
from hlp.objects.shapes import CUBE, ellipsoid, hull_mesh, tube
from hlp.records import ObjectModel
from hlp.rendering.sensor import Kinect, depth_error, noisy_depth

GREY = (128, 128, 128)


def box(*sides_mm: float) -> ObjectModel:
    sides = np.array(sides_mm) / 1000.0
    return shape_model(1, "box", hull_mesh(CUBE * sides / 2, np.array(GREY, dtype=np.uint8)))


def ball(colored: bool) -> ObjectModel:
    mesh = replace(ellipsoid((0.04, 0.04, 0.04), GREY), colored=colored)
    return shape_model(1, "ball", mesh)


def wire(radius_mm: float) -> ObjectModel:
    bends = [(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0.05), (0, 0.1, 0.1)]
    return shape_model(1, "wire", tube(bends, [radius_mm / 1000.0] * 4, GREY))


@pytest.mark.parametrize("model", demo_objects().values(), ids=lambda model: model.name)
@pytest.mark.parametrize("farthest_mm", [600.0, 1500.0])
def test_none_of_the_demos_objects_is_hard(model: ObjectModel, farthest_mm: float) -> None:
    assert hard_parts(model, farthest_mm) == []
    assert hard_parts(replace(model, mesh=replace(model.mesh, colored=False)), farthest_mm) == []


@pytest.mark.parametrize(
    ("model", "farthest_mm", "words", "easier", "nearer_mm"),
    [
        (box(100, 60, 8), 1000.0, "8 mm thick, and depth is off by 1.7 mm at 1000 mm",
         box(100, 60, 25), 600.0),
        (box(18, 18, 18), 1000.0, "18 px large at 1000 mm", box(60, 60, 60), 400.0),
        (wire(3), 800.0, "less than 7 px wide at 800 mm", wire(12), 300.0),
        (ball(colored=False), 1000.0, "like a ball", ball(colored=True), None),
    ],
)  # fmt: skip
def test_what_is_hard_is_said_with_the_reason_and_what_is_a_little_easier_is_not(
    model, farthest_mm, words, easier, nearer_mm
) -> None:
    sentences = hard_parts(model, farthest_mm)
    assert any(words in sentence for sentence in sentences), sentences
    assert all("help" in sentence for sentence in sentences)
    assert hard_parts(easier, farthest_mm) == []
    assert nearer_mm is None or hard_parts(model, nearer_mm) == []
    for nearer in re.findall(r"A camera within (\d+) mm", " ".join(sentences)):
        assert hard_parts(model, float(nearer) - 1.0) == []


def test_depth_is_off_by_what_the_sensor_adds() -> None:
    wall = np.full((200, 200), 1.3, dtype=np.float32)
    read = noisy_depth(wall, 572.0, np.random.default_rng(0), Kinect())
    assert np.std(read[read > 0]) == pytest.approx(depth_error(1.3), rel=0.1)


def test_learning_warns_of_each_object_at_its_own_distance(tmp_path, caplog) -> None:
    plate = tmp_path / "plate.stl"
    trimesh.creation.box((100, 60, 8)).export(plate)
    meshes = {"near": plate, "far": plate}
    with caplog.at_level(logging.WARNING):
        near, far = MeshChoices(farthest_mm=600.0), MeshChoices()
        build_models(meshes, {"near": near, "far": far}, 1)
    (warning,) = caplog.messages
    assert warning.startswith("far: warning: it is 8 mm thick")
