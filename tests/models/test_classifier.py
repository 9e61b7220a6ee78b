import numpy as np
import pytest
import pytorch_lightning as pl
import torch
from torch.utils.data import DataLoader, TensorDataset

from hlp.models.classifier import (
    ClassifierSettings,
    HolisticClassifier,
    HolisticCNN,
    class_probabilities,
    copy_weights,
    inference_network,
)

SETTINGS = ClassifierSettings("cnn", (6, 8), 16, 0.1, 0.01, 0.0, 8, 16)


@pytest.mark.parametrize("widths", [(4, 8), (24, 48, 96, 128)])
@pytest.mark.parametrize(("channels", "classes"), [(3, 16), (4, 2)])
def test_shapes_and_parameter_counts(widths, channels, classes):
    network = HolisticCNN(channels, classes, widths, 32, 0.2)
    assert network(torch.zeros(2, channels, 64, 64)).shape == (2, classes)
    expected, previous, side, kernel = 0, channels, 64, 5
    for width in widths:
        expected += kernel**2 * previous * width + 2 * width  # no bias before batch norm
        previous, side, kernel = width, side // 2, 3
    expected += previous * side**2 * 32 + 32 + 32 * classes + classes
    assert sum(each.numel() for each in network.parameters()) == expected


def trained(channels, classes):
    """A network whose batch norms have seen data, as training leaves them."""
    torch.manual_seed(0)
    network = HolisticCNN(channels, classes, (4, 8), 16, 0.5).train()
    for scale in (0.5, 1.0, 2.0):
        network(torch.randn(16, channels, 64, 64) * scale)
    return network


def test_probabilities_are_the_softmax_of_each_window():
    network = trained(4, 3)
    images = torch.rand(300, 4, 64, 64) * 2 - 1  # more than one chunk
    found = class_probabilities(inference_network(network), images)
    assert found.shape == (300, 3)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-5)
    assert network.training  # left as it was
    with torch.no_grad():
        expected = torch.softmax(network.eval()(images), dim=1).numpy()
    np.testing.assert_allclose(found, expected, atol=0.02)  # bfloat16


def test_what_is_said_of_a_window_does_not_depend_on_the_others():
    network = inference_network(trained(4, 3))
    images = torch.rand(300, 4, 64, 64) * 2 - 1
    together = class_probabilities(network, images)
    np.testing.assert_array_equal(class_probabilities(network, images[250:263]), together[250:263])
    np.testing.assert_array_equal(class_probabilities(network, images), together)  # no dropout


def test_no_windows_have_no_probabilities():
    network = inference_network(HolisticCNN(3, 5, (4, 8), 16, 0.1))
    assert class_probabilities(network, torch.zeros(0, 3, 64, 64)).shape == (0, 5)


def test_training_tells_classes_apart():
    torch.manual_seed(0)
    labels = torch.arange(48) % 3
    images = torch.randn(48, 3, 64, 64) * 0.1
    images[torch.arange(48), labels] += 0.5  # each class in a channel of its own
    module = HolisticClassifier(SETTINGS, 3, 3)
    trainer = pl.Trainer(
        accelerator="cpu", max_epochs=8, logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    loader = DataLoader(TensorDataset(images, labels), batch_size=16)

    def right():
        found = class_probabilities(inference_network(module.network), images)
        return (found.argmax(axis=1) == labels.numpy()).mean()

    before = right()
    module.train()
    trainer.fit(module, loader)
    assert before < 0.7
    assert right() > 0.95
    assert trainer.callback_metrics.keys() == {"loss", "accuracy"}
    (optimizer,) = trainer.optimizers
    assert optimizer.param_groups[0]["lr"] < SETTINGS.learning_rate / 100  # the cycle has ended


def test_weights_are_carried_over_class_by_class():
    torch.manual_seed(0)
    before, now = HolisticCNN(4, 3, (8, 8), 16, 0.0), HolisticCNN(4, 5, (8, 8), 16, 0.0)
    fresh = {name: value.clone() for name, value in now.state_dict().items()}
    copy_weights(now, before.state_dict(), {0: 0, 1: 2, 2: 4})
    images = torch.rand(6, 4, 64, 64)
    with torch.no_grad():
        expected, found = before.eval()(images), now.eval()(images)
    torch.testing.assert_close(found[:, [0, 2, 4]], expected)
    last = list(fresh)[-2]
    torch.testing.assert_close(now.state_dict()[last][[1, 3]], fresh[last][[1, 3]])
