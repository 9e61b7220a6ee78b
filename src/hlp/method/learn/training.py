"""Trains a Lightning module in a folder: resumable, with a history, quiet without a terminal."""

import logging
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytorch_lightning as pl
import torch
from pytorch_lightning.callbacks import Callback, TQDMProgressBar
from safetensors.torch import save
from torch import Tensor, nn

from hlp.files import replaced, write_csv
from hlp.method.learn.checkpoints import (
    HISTORY,
    WEIGHTS,
    CheckpointFiles,
    EpochCheckpoints,
    last_checkpoint,
)
from hlp.method.settings import TrainerSettings

_CHECKPOINTS = "checkpoints"
_CALIBRATION = 1024


def fit(
    module: pl.LightningModule,
    data: pl.LightningDataModule,
    network: nn.Module,
    epochs: int,
    trainer: TrainerSettings,
    folder: Path,
) -> None:
    """Train for `epochs`, continuing from the last checkpoint in `folder` if there is one.

    An interrupted and continued training ends with the same weights as an uninterrupted one.
    Damaged checkpoints are left out: it continues from the epoch before, or starts over. Writes the
    network's weights (`weights.safetensors`) and the metrics of each epoch (`history.csv`).
    """
    checkpoints = EpochCheckpoints(folder / _CHECKPOINTS)
    last = last_checkpoint(checkpoints.folder)
    callbacks: list[Callback] = [
        checkpoints,
        _History(folder / HISTORY),
        _RandomState(),
        _Threads(trainer.torch_threads),
    ]
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    with _quiet():
        engine = _make_trainer(trainer, epochs, callbacks, folder)
        with _stops(engine):
            engine.fit(module, data, ckpt_path=last, weights_only=True)
    weights = {name: value.contiguous() for name, value in network.state_dict().items()}
    with replaced(folder / WEIGHTS) as stream:  # its errors are the system's, unlike safetensors'
        stream.write(save(weights))
    checkpoints.remove()


def _make_trainer(
    trainer: TrainerSettings, epochs: int, callbacks: list[Callback], folder: Path
) -> pl.Trainer:
    terminal = sys.stderr.isatty()
    if terminal:
        callbacks = [*callbacks, TQDMProgressBar()]
    return pl.Trainer(
        accelerator=trainer.accelerator,
        devices=trainer.devices,
        strategy=trainer.strategy,
        precision=trainer.precision,
        max_epochs=epochs,
        use_distributed_sampler=False,  # our loaders divide the batches themselves
        callbacks=callbacks,
        plugins=[CheckpointFiles()],
        logger=False,
        enable_progress_bar=terminal,
        enable_model_summary=False,
        default_root_dir=folder,
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress Lightning's tips, and warnings about things that are intended."""
    logging.getLogger("pytorch_lightning").setLevel(logging.WARNING)
    with warnings.catch_warnings():
        # Batches come from memory, so worker processes would only copy them.
        warnings.filterwarnings("ignore", message=".*does not have many workers.*")
        warnings.filterwarnings("ignore", message=".*val_dataloader.*")
        # A resumed training finds its checkpoint there, as intended.
        warnings.filterwarnings("ignore", message=".*exists and is not empty.*")
        # `trainer.accelerator` decides.
        warnings.filterwarnings("ignore", message=".*GPU available but not used.*")
        # Between Lightning and torch.
        warnings.filterwarnings("ignore", message=".*LeafSpec.*")
        yield


@contextmanager
def _stops(engine: pl.Trainer) -> Iterator[None]:
    """Pass on Ctrl-C and SIGTERM, which Lightning turns into exits with 1 and 0.

    After Ctrl-C Lightning leaves SIGINT ignored.
    """
    try:
        yield
    except SystemExit as ended:
        if isinstance(ended.__context__, KeyboardInterrupt):
            if threading.current_thread() is threading.main_thread():
                signal.signal(signal.SIGINT, signal.default_int_handler)
            raise ended.__context__ from None
        if engine.received_sigterm:
            raise SystemExit(128 + signal.SIGTERM) from None
        raise


def calibration_images(data: pl.LightningDataModule, images_of: Callable[[Any], Tensor]) -> Tensor:
    """Images of the first training batches, enough to measure the ranges of activations."""
    found: list[Tensor] = []
    for batch in data.train_dataloader():
        # Degraded like the batch that would come next in training.
        found.append(images_of(data.on_before_batch_transfer(batch, 0)))
        if sum(len(each) for each in found) >= _CALIBRATION:
            break
    return torch.cat(found)[:_CALIBRATION]


# Not Lightning's CSVLogger: in a resumed training it deletes the rows of the epochs before.
class _History(Callback):
    """Writes the metrics of every epoch. Each checkpoint contains the rows so far."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[dict[str, float]] = []

    def on_train_epoch_end(self, trainer: pl.Trainer, _: pl.LightningModule) -> None:
        metrics = {name: float(value) for name, value in sorted(trainer.callback_metrics.items())}
        self.rows.append({"epoch": trainer.current_epoch, **metrics})
        self._write(trainer)

    def on_fit_end(self, trainer: pl.Trainer, _: pl.LightningModule) -> None:
        self._write(trainer)  # also if a resumed training had no epoch left

    def _write(self, trainer: pl.Trainer) -> None:
        if self.rows and trainer.is_global_zero:
            columns = list(self.rows[0])
            write_csv(self.path, columns, [[row[name] for name in columns] for row in self.rows])

    def state_dict(self) -> dict[str, Any]:
        return {"rows": self.rows}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.rows = list(state["rows"])


class _RandomState(Callback):
    """Stores torch's random state, from which dropout draws, with each checkpoint.

    It is restored when the checkpoint is loaded, before Lightning makes the epoch's batches, which
    draws random numbers too.
    """

    def state_dict(self) -> dict[str, Any]:
        return {"torch": torch.get_rng_state()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        torch.set_rng_state(state["torch"])


class _Threads(Callback):
    """Sets torch's number of threads, which affects the last bits, in every training process."""

    def __init__(self, threads: int) -> None:
        self.threads = threads

    def setup(self, trainer: pl.Trainer, pl_module: pl.LightningModule, stage: str) -> None:
        torch.set_num_threads(self.threads)
