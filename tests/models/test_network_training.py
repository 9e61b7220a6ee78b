"""Losses and learning rates of the networks, and that training works."""

from dataclasses import replace

import numpy as np
import pytest
import pytorch_lightning as pl
import torch
from scipy.spatial.transform import Rotation
from scipy.special import logsumexp
from torch.utils.data import DataLoader, TensorDataset

from hlp.models.classifier import ClassifierSettings
from hlp.models.encoder import patch_input
from hlp.models.network_encoders import AutoencoderSettings, ContrastiveSettings
from hlp.models.network_training import (
    Autoencoder,
    ContrastiveEncoder,
    HolisticClassifier,
    HolisticCNN,
    copy_weights,
    encoder_input,
    one_cycle,
    raise_background,
)
from view_records import random_patches

# Steps are called without a trainer: their logging has nowhere to go, and says so.
pytestmark = pytest.mark.filterwarnings("ignore:.*self.trainer.*:UserWarning")

CNN = ClassifierSettings("cnn", (6, 8), 16, 0.1, 0.01, 0.0, 8, 16)
SETTINGS = ContrastiveSettings(
    "contrastive", "normals_depth", 12, (6, 8), 0.1, 15.0, 20.0, 3e-3, 0.0, 1, 8
)
CAE = AutoencoderSettings("cae", "rgbd", 16, (8, 16), 3e-3, 0.0, 1, 32, 100)
COUNT = 8


def fitted(module, batches, epochs):
    trainer = pl.Trainer(
        accelerator="cpu", max_epochs=epochs, logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    trainer.fit(module, batches)
    return trainer


def test_training_tells_classes_apart():
    torch.manual_seed(0)
    labels = torch.arange(48) % 3
    images = torch.randn(48, 3, 64, 64) * 0.1
    images[torch.arange(48), labels] += 0.5  # each class in a channel of its own
    module = HolisticClassifier(CNN, 3, 3)
    loader = DataLoader(TensorDataset(images, labels), batch_size=16)

    def right():
        with torch.no_grad():
            found = module.network.eval()(images)
        return (found.argmax(dim=1) == labels).float().mean()

    before = right()
    module.train()
    trainer = fitted(module, loader, 8)
    assert before < 0.7
    assert right() > 0.95
    assert trainer.callback_metrics.keys() == {"loss", "accuracy"}
    (optimizer,) = trainer.optimizers
    assert optimizer.param_groups[0]["lr"] < CNN.learning_rate / 100  # the cycle has ended


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
    settings = replace(CNN, epochs=8, batch_size=16, min_batches=200)
    assert settings.epochs_for(windows) == epochs


@pytest.mark.parametrize("rise", [0.1, 0.2])
@pytest.mark.parametrize("steps", [1, 2, 5, 9, 10, 11, 20, 100])
def test_the_rate_rises_and_falls_to_nothing(steps, rise):
    optimizer = torch.optim.AdamW([torch.zeros(1, requires_grad=True)], lr=1.0)
    schedule = one_cycle(optimizer, 1.0, steps, rise)["lr_scheduler"]["scheduler"]
    rates = []
    for _ in range(steps):
        rates.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        schedule.step()
    assert all(0.0 <= rate <= 1.0 for rate in rates)
    if steps >= 20:
        top = rates.index(max(rates))
        assert max(rates) > 0.9 and abs(top - rise * steps) <= 2 and rates[-1] < 0.05
        assert rates[:top] == sorted(rates[:top]) and rates[top:] == sorted(rates[top:])[::-1]


def make_batch(seed=0):
    gen = torch.Generator().manual_seed(seed)
    valid = torch.ones((COUNT, 32, 32), dtype=torch.bool)

    def side(noise):
        depth = clean + noise * torch.randn((COUNT, 32, 32), generator=gen)
        return torch.rand((COUNT, 3, 32, 32), generator=gen), depth.clamp(-1, 1), valid

    coarse = torch.randn((COUNT, 1, 4, 4), generator=gen)
    clean = torch.nn.functional.interpolate(coarse, (32, 32), mode="bilinear")[:, 0] * 0.3
    rotations = Rotation.random(COUNT, random_state=seed).as_matrix()
    return {
        "noisy": side(0.02),
        "clean": side(0.0),
        "object_ids": torch.arange(COUNT),
        "points_obj": torch.rand((COUNT, 3), generator=gen),
        "rotations": torch.from_numpy(rotations).float(),
    }


def reference(module, batch, excluded=()):
    """Symmetric InfoNCE, written out with loops, without the `excluded` pairs (i, j)."""
    with torch.no_grad():
        images = torch.cat([encoder_input(*batch[s], SETTINGS.input) for s in ("noisy", "clean")])
        features = module.network(images).numpy().astype(np.float64)
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    noisy, clean = features[:COUNT], features[COUNT:]
    losses = []
    for i in range(COUNT):
        others = [j for j in range(COUNT) if (i, j) not in excluded]
        forth = [noisy[i] @ clean[j] / SETTINGS.temperature for j in others]
        back = [clean[i] @ noisy[j] / SETTINGS.temperature for j in others]
        own = noisy[i] @ clean[i] / SETTINGS.temperature
        losses += [logsumexp(forth) - own, logsumexp(back) - own]
    return np.mean(losses)


@pytest.fixture
def module():
    torch.manual_seed(0)
    return ContrastiveEncoder(SETTINGS).eval()


def test_loss_is_symmetric_infonce(module):
    batch = make_batch()
    loss = module.training_step(batch, 0).item()
    assert loss == pytest.approx(reference(module, batch), rel=1e-4)


# object, distance (mm), angle (degrees) of pairs 0 and 1; are they too alike to be told apart?
CASES = [
    (0, 14.0, 19.0, True),
    (0, 16.0, 19.0, False),
    (0, 14.0, 21.0, False),
    (1, 14.0, 19.0, False),
]


@pytest.mark.parametrize(("other", "millimetres", "degrees", "near"), CASES)
def test_near_neighbours_of_one_object_are_no_negatives(module, other, millimetres, degrees, near):
    batch = make_batch()
    batch["object_ids"][1] = other
    batch["points_obj"][1] = batch["points_obj"][0] + torch.tensor([0.0, millimetres / 1000, 0.0])
    turn = torch.from_numpy(Rotation.from_euler("y", degrees, degrees=True).as_matrix())
    batch["rotations"][1] = turn.float() @ batch["rotations"][0]
    excluded = {(0, 1), (1, 0)} if near else set()
    found = module.training_step(batch, 0).item()
    assert found == pytest.approx(reference(module, batch, excluded), rel=1e-4)
    if near:
        assert found < reference(module, batch) - 1e-4


@pytest.mark.parametrize("kind", ["rgbd", "normals_depth"])
def test_training_sees_patches_as_detection_does(kind):
    patches = random_patches(5, seed=1)
    levels = torch.from_numpy(patches.color).permute(0, 3, 1, 2) / 255.0
    depth, valid = torch.from_numpy(patches.depth), torch.from_numpy(patches.valid)
    found = encoder_input(levels, depth, valid, kind)
    assert found.shape == (5, 4, 32, 32)
    expected = patch_input(patches, kind).transpose(0, 3, 1, 2)
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-6)


def smooth_patches(count=32):
    """Patches of smooth colour and tilted depth."""
    gen = torch.Generator().manual_seed(0)
    axis = torch.linspace(-1, 1, 32)
    slope = torch.rand((count, 1, 1), generator=gen) - 0.5
    depth = (slope * axis).expand(count, 32, 32).contiguous()
    color = torch.rand((count, 1, 1, 3), generator=gen).expand(count, 32, 32, 3) * 255
    return {
        "color": color.to(torch.uint8),
        "depth": depth,
        "valid": torch.ones_like(depth, dtype=torch.bool),
    }


@pytest.mark.parametrize("widths", [(8, 16), (4, 8, 8, 16)])
def test_a_reconstruction_has_the_shape_of_its_patch(widths):
    images = Autoencoder(replace(CAE, widths=widths))(torch.rand(2, 4, 32, 32))
    assert images.shape == (2, 4, 32, 32) and images.abs().max() <= 1


@pytest.mark.parametrize("varied_light", [False, True])
def test_loss_is_the_mean_squared_error_against_the_patch_as_it_was(varied_light):
    torch.manual_seed(0)
    module, batch = Autoencoder(CAE).eval(), smooth_patches(4)
    depth, color = batch["depth"][:, None], batch["color"].permute(0, 3, 1, 2) / 255.0
    wanted = torch.cat([color * 2 - 1, depth], dim=1)
    given = wanted
    if varied_light:
        batch["seen"] = torch.rand((4, 3, 32, 32), generator=torch.Generator().manual_seed(1))
        given = torch.cat([batch["seen"] * 2 - 1, depth], dim=1)
    expected = ((module(given) - wanted) ** 2).mean()
    torch.testing.assert_close(module.training_step(batch, 0), expected)


@pytest.mark.parametrize("cycle", [False, True])
def test_the_rate_is_constant_or_falls_to_nothing(cycle):
    settings = replace(CAE, one_cycle=cycle)
    module = Autoencoder(settings)
    trainer = fitted(module, DataLoader([smooth_patches()], batch_size=None), 20)
    (optimizer,) = trainer.optimizers
    rate = optimizer.param_groups[0]["lr"]
    assert rate < settings.learning_rate / 100 if cycle else rate == settings.learning_rate
