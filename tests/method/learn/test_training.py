import os
import pickle

import pytest
import pytorch_lightning as pl
import torch
from torch import nn
from torch.nn import functional

from damage import WAYS, damage
from hlp.errors import DataError
from hlp.fingerprints import content_checksum
from hlp.method.learn.model_files import HISTORY, WEIGHTS, read_history, read_weights
from hlp.method.learn.training import CheckpointFiles, fit, last_checkpoint
from hlp.method.settings import TrainerSettings
from hlp.patches.pool_loader import PoolDataModule

CPU = TrainerSettings("cpu", "cpu", 1, "auto", "32-true", 2)
EPOCHS = 4


class StopError(RuntimeError):
    pass


class Data(PoolDataModule):
    """Batches with noise drawn from the trainer's step, as the real ones have."""

    def __init__(self, seed):
        images = torch.randn((48, 2, 8, 8), generator=torch.Generator().manual_seed(7))
        labels = (images.mean(dim=(1, 2, 3)) > 0).long()
        super().__init__({"image": images.numpy(), "label": labels.numpy()}, 16, seed)

    def on_before_batch_transfer(self, batch, dataloader_idx):
        gen = torch.Generator().manual_seed(self.trainer.global_step)
        noise = torch.randn(batch["image"].shape, generator=gen)
        return batch["image"] + 0.1 * noise, batch["label"]


class Net(pl.LightningModule):
    """Batch norm, dropout, momentum and a schedule: all the state that a resumed run needs."""

    def __init__(self, stop_at=None):
        super().__init__()
        self.network = nn.Sequential(
            nn.Conv2d(2, 4, 3, stride=2),
            nn.BatchNorm2d(4),
            nn.ReLU(),
            nn.Flatten(),
            nn.Dropout(0.5),
            nn.Linear(36, 2),
        )
        self.stop_at = stop_at
        self.seen = []

    def training_step(self, batch, _):
        if self.global_step == self.stop_at:
            raise StopError
        images, labels = batch
        self.seen.append(float(images.sum()))
        loss = functional.cross_entropy(self.network(images), labels)
        self.log("loss", loss, on_step=False, on_epoch=True)
        return loss

    def configure_optimizers(self):
        optimizer = torch.optim.AdamW(self.parameters(), lr=0.01)
        steps = int(self.trainer.estimated_stepping_batches)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 0.01, total_steps=steps)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


def train(folder, stop_at=None, seed=0):
    torch.manual_seed(3)
    module = Net(stop_at)
    fit(module, Data(seed), module.network, EPOCHS, CPU, folder)
    return module


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return folder, train(folder)


@pytest.mark.parametrize("stops", [(4,), (3, 8), (11,)])
def test_resumed_training_equals_an_uninterrupted_one_bit_for_bit(uninterrupted, tmp_path, stops):
    whole, module = uninterrupted
    for stop in stops:
        with pytest.raises(StopError):
            train(tmp_path, stop)
        assert not (tmp_path / WEIGHTS).exists()
        torch.rand(17)  # whatever else draws in between
    resumed = train(tmp_path)
    finished = stops[-1] // 3  # epochs of 3 steps each
    assert resumed.seen == module.seen[3 * finished :]  # the same batches, in order
    (tmp_path / "other").mkdir()
    assert train(tmp_path / "other", seed=1).seen != module.seen
    expected = torch.load(whole / WEIGHTS, weights_only=True)
    for name, value in torch.load(tmp_path / WEIGHTS, weights_only=True).items():
        assert torch.equal(value, expected[name]), name
    assert (tmp_path / HISTORY).read_bytes() == (whole / HISTORY).read_bytes()


def test_history_holds_every_epoch_and_weights_load(uninterrupted, tmp_path):
    folder, module = uninterrupted
    history = read_history(folder)
    assert [row["epoch"] for row in history] == [0, 1, 2, 3]
    assert history[-1]["loss"] < history[0]["loss"]
    found, expected = read_weights(folder), module.network.state_dict()
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert torch.equal(found[name], value)
    assert sorted(path.name for path in folder.iterdir()) == [HISTORY, WEIGHTS]
    assert read_history(tmp_path) == []  # of a stage without training
    with pytest.raises(FileNotFoundError, match=WEIGHTS):
        read_weights(tmp_path)


@pytest.mark.parametrize("how", [*WAYS, "checksum flipped"])
def test_a_damaged_checkpoint_is_dropped_for_the_one_before(tmp_path, how, caplog):
    older, newer = (tmp_path / f"epoch-{epoch:06d}.ckpt" for epoch in (2, 3))
    for path in (older, newer):
        CheckpointFiles().save_checkpoint({"weight": torch.arange(6.0)}, path)
    assert last_checkpoint(tmp_path) == newer
    if how in WAYS:
        damage([newer], how)
    else:
        newer.write_bytes(b"?" + newer.read_bytes()[1:])
    with pytest.raises(DataError, match=r"epoch-000003\.ckpt is damaged"):
        CheckpointFiles().load_checkpoint(newer)
    assert last_checkpoint(tmp_path) == older
    assert not newer.exists()
    (message,) = caplog.messages
    assert str(newer) in message
    older.write_bytes(b"")
    assert last_checkpoint(tmp_path) is None
    assert last_checkpoint(tmp_path / "absent") is None


class Attack:
    def __init__(self, touched):
        self.touched = touched

    def __reduce__(self):
        return os.mkdir, (str(self.touched),)


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")  # not torch's own: an attack
@pytest.mark.parametrize("by", ["torch", "pickle"])
def test_a_strangers_checkpoint_runs_no_code(tmp_path, by):
    """Its checksum is right: whoever writes code can also compute checksums."""
    path, touched = tmp_path / "epoch-000009.ckpt", tmp_path / "touched"
    content = pickle.dumps(Attack(touched))
    if by == "torch":
        torch.save({"state_dict": Attack(touched)}, tmp_path / "bare")
        content = (tmp_path / "bare").read_bytes()
    path.write_bytes(content_checksum(content).encode() + b"\n" + content)
    assert last_checkpoint(tmp_path) is None
    assert not touched.exists()
    pickle.loads(pickle.dumps(Attack(touched)))
    assert touched.exists()  # the attack works where it is unpickled


class Alone(Data):
    """Batches as they are: the noise is drawn anew in every process."""

    def on_before_batch_transfer(self, batch, dataloader_idx):
        return batch["image"], batch["label"]


@pytest.mark.slow
@pytest.mark.thorough
def test_two_processes_learn_what_one_learns_from_the_same_batches(tmp_path):
    """Their mean gradient is that of the whole batch, so the weights agree but for rounding."""
    two = TrainerSettings("ddp", "cpu", 2, "ddp_spawn", "32-true", 1)
    weights = []
    for trainer, folder in ((CPU, tmp_path / "one"), (two, tmp_path / "two")):
        folder.mkdir()
        torch.manual_seed(3)
        module = Net()  # without batch norm and dropout, which know one process's share only
        layers = nn.Conv2d(2, 4, 3), nn.ReLU(), nn.Flatten(), nn.Linear(144, 2)
        module.network = nn.Sequential(*layers)
        before = module.network[0].weight.clone()
        fit(module, Alone(0), module.network, EPOCHS, trainer, folder)
        assert not torch.allclose(module.network[0].weight, before, atol=1e-2)
        assert sorted(path.name for path in folder.iterdir()) == [HISTORY, WEIGHTS]
        assert [row["epoch"] for row in read_history(folder)] == [0, 1, 2, 3]
        weights.append(torch.load(folder / WEIGHTS, weights_only=True))
    for name, value in weights[0].items():
        torch.testing.assert_close(weights[1][name], value, atol=1e-4, rtol=0.0)
    assert torch.get_num_threads() == CPU.torch_threads  # theirs are not this process's
