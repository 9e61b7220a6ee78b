"""An object's model on disk."""

import dataclasses
import json

import numpy as np
import pytest

from hlp.data.synthetic.objects import demo_objects
from hlp.errors import DataError
from hlp.method.learn.model_files import read_model, write_model
from hlp.objects.object_model import model_identity
from hlp.records import Texture
from hlp.rendering.surface import color_grid


@pytest.fixture(scope="module")
def model():
    plain = next(iter(demo_objects().values()))
    rng = np.random.default_rng(0)
    texture = Texture(
        rng.integers(0, 256, (20, 30, 3)).astype(np.uint8),
        rng.random((len(plain.mesh.vertices), 2)),
    )
    return dataclasses.replace(
        plain,
        mesh=dataclasses.replace(plain.mesh, texture=texture),
        near_symmetries=np.diag([-1.0, -1.0, 1.0, 1.0])[None],
    )


def test_a_model_comes_back_with_its_texture_and_near_symmetries(tmp_path, model):
    write_model(tmp_path, model)
    back = read_model(tmp_path)
    assert model_identity(back) == model_identity(model)
    np.testing.assert_array_equal(back.mesh.texture.image, model.mesh.texture.image)
    np.testing.assert_array_equal(back.near_symmetries, model.near_symmetries)
    assert back.proxy.texture is None and back.mesh.colored


def test_a_mesh_without_colours_stays_one(tmp_path, model):
    grey = dataclasses.replace(model.mesh, texture=None, colored=False)
    write_model(tmp_path, dataclasses.replace(model, mesh=grey))
    back = read_model(tmp_path)
    assert not back.mesh.colored and back.mesh.texture is None
    assert not (tmp_path / "texture.png").exists() and not (tmp_path / "colors.npz").exists()


def test_colours_in_cells_come_back_as_they_are_computed(tmp_path, model):
    write_model(tmp_path, model)
    stored = read_model(tmp_path).mesh
    assert stored.color_grid is not None and color_grid(stored) is stored.color_grid
    (tmp_path / "colors.npz").unlink()  # as of an object that was learnt by an earlier version
    computed = color_grid(read_model(tmp_path).mesh)
    np.testing.assert_array_equal(stored.color_grid.colors, computed.colors)
    np.testing.assert_array_equal(stored.color_grid.corner, computed.corner)
    assert stored.color_grid.cell == computed.cell


@pytest.mark.parametrize("name", ["colors.npz", "texture.png"])
def test_damaged_colours_are_named(tmp_path, model, name):
    write_model(tmp_path, model)
    (tmp_path / name).write_bytes(b"PK")
    with pytest.raises(DataError, match=name):
        read_model(tmp_path)


def test_a_missing_array_is_named(tmp_path, model):
    write_model(tmp_path, model)
    np.savez(tmp_path / "colors.npz", corner=np.zeros(3))
    with pytest.raises(DataError, match="colors"):
        read_model(tmp_path)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"colored": 1}, "colored is 1: it must be true or false"),
        ({"diameter": 0.0}, "diameter is 0.0: it must be above 0"),
    ],
)
def test_an_object_that_is_not_as_its_schema_is_named(tmp_path, model, values, words):
    write_model(tmp_path, model)
    path = tmp_path / "object.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | values))
    with pytest.raises(DataError) as caught:
        read_model(tmp_path)
    assert str(caught.value) == f"{path}: {words}"
