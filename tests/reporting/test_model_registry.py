"""Learnt objects in MLflow's registry, loaded from there as any user of MLflow would."""

from pathlib import Path

import numpy as np
import pytest

from hlp import Detector
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.errors import ConfigError, InputError
from hlp.reporting.mlflow_client import import_client
from hlp.reporting.model_registry import register


def test_a_registered_model_finds_what_the_detector_finds(
    learnt: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    uri = f"sqlite:///{tmp_path / 'work' / 'mlflow.db'}"
    assert register(learnt, "shapes", uri, {"objects": "bear, can"}) == "models:/shapes/1"
    assert register(learnt, "shapes", uri, {}) == "models:/shapes/2"
    import_client()
    import mlflow

    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    monkeypatch.setattr(mlflow.tracking._tracking_service.utils, "_tracking_uri", uri)
    model = mlflow.pyfunc.load_model("models:/shapes/1")
    settings = SyntheticSettings(scenes=1, width=320, height=240, objects=(5, 5), clutter=(1, 3))
    frame = SyntheticScenes(settings).load("000000_000000")
    image = {"rgb": frame.rgb, "depth": frame.depth, "camera_matrix": frame.camera_matrix}
    options = {"max_instances": 1, "min_score": 0.0}
    (found,) = model.predict([image | options])
    detector = Detector.load(learnt)
    expected = detector.detect(*image.values(), **options)
    assert [each["object"] for each in found] == [each.object for each in expected] != []
    np.testing.assert_array_equal(found[0]["pose_cam_obj"], expected[0].pose_cam_obj)
    with pytest.raises(InputError, match="min_scores is no option"):
        model.predict([image | {"min_scores": 0.0}])
    with pytest.raises(InputError, match="depth is missing"):
        model.predict([{"rgb": frame.rgb}])


def test_a_name_that_mlflow_refuses_is_named(learnt: Path, tmp_path: Path) -> None:
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    with pytest.raises(ConfigError, match="a/b"):
        register(learnt, "a/b", uri, {})
