from dataclasses import replace

import pytest
import pytorch_lightning as pl
import torch
from torch.utils.data import DataLoader, TensorDataset

from hlp.models.classifier import ClassifierSettings
from hlp.models.classifier_training import (
    HolisticClassifier,
    HolisticCNN,
    copy_weights,
    raise_background,
)

SETTINGS = ClassifierSettings("cnn", (6, 8), 16, 0.1, 0.01, 0.0, 8, 16)


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
        with torch.no_grad():
            found = module.network.eval()(images)
        return (found.argmax(dim=1) == labels).float().mean()

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


def test_raising_the_background_divides_every_objects_odds():
    torch.manual_seed(0)
    network = HolisticCNN(3, 3, (4, 4), 8, 0.0).eval()
    images = torch.rand(5, 3, 64, 64)
    with torch.no_grad():
        before = network(images).softmax(dim=1)
        raise_background(network, 8.0)
        after = network(images).softmax(dim=1)
    torch.testing.assert_close(after[:, 1:] / after[:, :1], before[:, 1:] / before[:, :1] / 8.0)
    torch.testing.assert_close(after[:, 1] / after[:, 2], before[:, 1] / before[:, 2])


@pytest.mark.parametrize(
    ("windows", "epochs"), [(16 * 100, 8), (16 * 25, 8), (16 * 20 + 3, 10), (5, 200)]
)
def test_few_windows_are_shown_in_more_epochs(windows, epochs):
    settings = replace(SETTINGS, epochs=8, batch_size=16, min_batches=200)
    assert settings.epochs_for(windows) == epochs
