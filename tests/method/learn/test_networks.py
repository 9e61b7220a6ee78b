import numpy as np
import pytest
import torch

from hlp.method.learn.model_files import load_classifier
from hlp.method.settings import MachineSettings
from hlp.models.classifier_training import HolisticCNN
from hlp.models.encoder_training import PatchEncoder
from hlp.models.network_encoders import AutoencoderSettings, ContrastiveSettings
from hlp.models.onnx_export import export_network
from hlp.models.pca import PcaSettings
from hlp.records import LocalPatches

MACHINE = MachineSettings("local", 1, "cpu")
CAE = AutoencoderSettings("cae", "rgbd", 16, (8, 16), 3e-3, 0.0, 1, 32, 100)
CONTRASTIVE = ContrastiveSettings(
    "contrastive", "normals_depth", 16, (8, 16), 0.1, 15.0, 20.0, 3e-3, 0.0, 1, 8
)


def patches():
    rng = np.random.default_rng(0)
    return LocalPatches(
        rng.integers(0, 256, (6, 32, 32, 3)).astype(np.uint8),
        rng.uniform(-1, 1, (6, 32, 32)).astype(np.float32),
        rng.random((6, 32, 32)) < 0.9,
        np.zeros((6, 3)),
        np.zeros((6, 2)),
    )


@pytest.mark.parametrize(("settings", "unit"), [(CAE, False), (CONTRASTIVE, True)])
def test_the_settings_decide_what_a_network_sees_and_gives(settings, unit, tmp_path):
    torch.manual_seed(0)
    network = PatchEncoder(settings.widths, settings.dimension)
    sample = torch.rand(8, 4, 32, 32) * 2 - 1
    export_network(network.layers, sample, tmp_path / "encoder", levels=False)
    encoder = settings.load(tmp_path, 1, "cpu")
    features = encoder.encode(patches())
    assert features.shape == (6, 16)
    assert encoder.sees_color == (settings.input == "rgbd")
    norms = np.linalg.norm(features, axis=1)
    assert np.allclose(norms, 1.0, atol=1e-5) == unit


def test_principal_components_need_no_network(tmp_path):
    np.savez(tmp_path / "pca.npz", mean=np.zeros(48), components=np.eye(7, 48, dtype=np.float32))
    assert PcaSettings("pca", 7, 4).load(tmp_path, 1, "cpu").encode(patches()).shape[1] == 7


def test_the_classifier_has_a_class_for_each_object_and_background(tmp_path):
    network = HolisticCNN(4, 5, (4, 8), 16, 0.1)
    sample = torch.rand(8, 4, 64, 64) * 2 - 1
    export_network(network.layers, sample, tmp_path / "classifier", levels=True)
    assert load_classifier(tmp_path, MACHINE).outputs == 5
