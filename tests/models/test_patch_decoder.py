import numpy as np
import pytest
import torch

from hlp.errors import DataError
from hlp.models.encoder import FeatureDecoder
from hlp.models.encoder_training import DECODER, Autoencoder, decode, save_decoder
from hlp.models.network_encoders import AutoencoderSettings, ContrastiveSettings
from hlp.models.pca import PcaSettings

SETTINGS = AutoencoderSettings(dimension=16, widths=(8, 16))


@pytest.fixture
def module():
    torch.manual_seed(0)
    return Autoencoder(SETTINGS).eval()


def test_what_is_kept_rebuilds_patches_as_the_autoencoder_does(module, tmp_path):
    save_decoder(module.decoder, tmp_path)
    images = torch.rand(5, 4, 32, 32) * 2 - 1
    with torch.inference_mode():
        features, expected = module.network(images), module(images)
    rebuilt = SETTINGS.decode(tmp_path, features.numpy())
    assert rebuilt is not None
    np.testing.assert_allclose(rebuilt.transpose(0, 3, 1, 2), expected.numpy(), atol=1e-6)


def test_training_keeps_the_decoder_that_was_trained(tmp_path):
    trained = []

    class Training:
        folder = tmp_path

        def frame_batches(self, *_):
            return None

        def fit(self, module, *_):
            trained.append(module)
            torch.nn.init.constant_(module.decoder.expand.bias, 0.25)

    SETTINGS.train(Training())
    features = np.random.default_rng(0).normal(size=(2, 16))
    rebuilt = SETTINGS.decode(tmp_path, features)
    with torch.inference_mode():
        expected = trained[0].eval().decoder(torch.from_numpy(features.astype(np.float32)))
    assert rebuilt is not None
    np.testing.assert_allclose(rebuilt.transpose(0, 3, 1, 2), expected.numpy(), atol=1e-6)


def test_an_encoder_whose_training_kept_no_decoder_rebuilds_nothing(tmp_path):
    assert SETTINGS.decode(tmp_path, np.zeros((1, 16))) is None


def test_a_decoder_that_is_damaged_or_of_another_size_is_an_error(module, tmp_path):
    save_decoder(module.decoder, tmp_path)
    with pytest.raises(DataError, match=r"decoder\.safetensors is no decoder of this encoder"):
        decode(tmp_path, (8, 8), np.zeros((1, 16)))
    (tmp_path / DECODER).write_bytes(b"no tensors")
    with pytest.raises(DataError, match=r"decoder\.safetensors"):
        decode(tmp_path, SETTINGS.widths, np.zeros((1, 16)))


def test_only_the_autoencoder_turns_features_back():
    assert isinstance(SETTINGS, FeatureDecoder)
    assert not isinstance(ContrastiveSettings(), FeatureDecoder)
    assert not isinstance(PcaSettings(), FeatureDecoder)
