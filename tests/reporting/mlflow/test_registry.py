"""Learnt objects in MLflow's registry, loaded from there as any user of MLflow would."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from mlflow.exceptions import MlflowException

from hlp import Detector
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.errors import ConfigError
from hlp.reporting.mlflow import import_client
from hlp.runs.mlflow_log import register_learnt

if TYPE_CHECKING:
    from mlflow.pyfunc import PyFuncModel


@pytest.fixture(scope="module")
def model(learnt: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator["PyFuncModel"]:
    """The first of two versions."""
    folder = tmp_path_factory.mktemp("registry")
    uri = f"sqlite:///{folder / 'work' / 'mlflow.db'}"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert register_learnt(learnt, "shapes", uri) == "models:/shapes/1"
        assert register_learnt(learnt, "shapes", uri) == "models:/shapes/2"
        import_client()
        import mlflow

        patch.setenv("MLFLOW_TRACKING_URI", uri)
        patch.setattr(mlflow.tracking._tracking_service.utils, "_tracking_uri", uri)
        yield mlflow.pyfunc.load_model("models:/shapes/1")


def test_a_registered_model_finds_what_the_detector_finds(
    learnt: Path, model: "PyFuncModel"
) -> None:
    settings = SyntheticSettings(scenes=1, width=320, height=240, objects=(5, 5), clutter=(1, 3))
    frame = SyntheticScenes(settings).load("000000_000000")
    image = {"rgb": frame.rgb, "depth": frame.depth, "camera_matrix": frame.camera_matrix}
    options = {"objects": ["bear"], "max_instances": 1, "min_score": 0.0}
    found = model.predict({key: np.stack([value] * 2) for key, value in image.items()}, options)
    expected = Detector.load(learnt).detect(*image.values(), **options)
    assert [row["object"] for row in found] == 2 * [answer.object for answer in expected] != []
    assert [row["image"] for row in found] == [0] * len(expected) + [1] * len(expected)
    np.testing.assert_array_equal(found[0]["pose_cam_obj"], expected[0].pose_cam_obj)


def test_mlflow_knows_what_the_model_takes_and_returns(model: "PyFuncModel") -> None:
    """And the example that is shown with it is one that the model can be called with."""
    signature = model.metadata.signature
    takes = {column.name: (str(column.type), column.shape) for column in signature.inputs}
    assert takes == {
        "rgb": ("uint8", (-1, -1, -1, 3)),
        "depth": ("float32", (-1, -1, -1)),
        "camera_matrix": ("float64", (-1, 3, 3)),
    }
    options = {param.name: param.default for param in signature.params}
    assert list(options["objects"]) == ["bear", "can"]
    assert options["max_instances"] == 10
    example = model.input_example
    assert {key: value.dtype.name for key, value in example.items()} == {
        name: dtype for name, (dtype, _) in takes.items()
    }
    rows = model.predict(example, {"min_score": 0.0, "max_instances": 1})
    assert rows[0].keys() == set(signature.outputs.input_names())
    assert np.shape(rows[0]["pose_cam_obj"]) == (4, 4)
    with pytest.raises(MlflowException, match="depth"):
        model.predict({key: value for key, value in example.items() if key != "depth"})


def test_a_name_that_mlflow_refuses_is_named(learnt: Path, tmp_path: Path) -> None:
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    with pytest.raises(ConfigError, match="a/b"):
        register_learnt(learnt, "a/b", uri)
