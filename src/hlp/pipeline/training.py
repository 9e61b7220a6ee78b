"""Fits a Lightning module in a stage's folder: resumable, quiet off a terminal, history on disk."""

import csv
import sys
import warnings
from pathlib import Path

import pytorch_lightning as pl
import torch
from pytorch_lightning.callbacks import Callback, ModelCheckpoint, TQDMProgressBar
from torch import nn

from hlp.pipeline.settings import TrainerSettings

HISTORY = "history.csv"
WEIGHTS = "weights.pt"
_CHECKPOINTS = "checkpoints"


def fit(
    module: pl.LightningModule,
    data: pl.LightningDataModule,
    network: nn.Module,
    epochs: int,
    trainer: TrainerSettings,
    folder: Path,
) -> None:
    """Train for `epochs`, going on from the last checkpoint in `folder` where there is one.

    Leaves the network's weights (`weights.pt`) and the metrics of every epoch (`history.csv`).
    """
    checkpoints = folder / _CHECKPOINTS
    callbacks: list[Callback] = [
        ModelCheckpoint(checkpoints, filename="epoch", save_last=True, save_top_k=0),
        _History(folder / HISTORY),
    ]
    terminal = sys.stderr.isatty()
    if terminal:
        callbacks.append(TQDMProgressBar())
    engine = pl.Trainer(
        accelerator=trainer.accelerator,
        devices=trainer.devices,
        strategy=trainer.strategy,
        precision=trainer.precision,  # type: ignore[arg-type]
        max_epochs=epochs,
        callbacks=callbacks,
        logger=False,
        enable_progress_bar=terminal,
        enable_model_summary=False,
        default_root_dir=folder,
    )
    last = checkpoints / "last.ckpt"
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    with warnings.catch_warnings():
        # Batches come from memory, so worker processes would only copy them.
        warnings.filterwarnings("ignore", message=".*does not have many workers.*")
        warnings.filterwarnings("ignore", message=".*val_dataloader.*")
        engine.fit(module, data, ckpt_path=str(last) if last.exists() else None, weights_only=False)
    torch.save(network.state_dict(), folder / WEIGHTS)
    _remove(checkpoints)


def load_weights(network: nn.Module, folder: Path) -> None:
    """Load what `fit` left. Raises FileNotFoundError where the stage was not finished."""
    network.load_state_dict(torch.load(folder / WEIGHTS, weights_only=True))


def read_history(folder: Path) -> list[dict[str, float]]:
    """Metrics of every epoch, in order; empty where a stage trains nothing."""
    path = folder / HISTORY
    if not path.exists():
        return []
    with path.open(newline="") as stream:
        return [
            {name: float(value) for name, value in row.items()} for row in csv.DictReader(stream)
        ]


class _History(Callback):
    """Appends each epoch's metrics to a file that survives an interruption."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def on_train_epoch_end(self, trainer: pl.Trainer, _: pl.LightningModule) -> None:
        metrics = {name: float(value) for name, value in sorted(trainer.callback_metrics.items())}
        row = {"epoch": trainer.current_epoch, **metrics}
        fresh = not self.path.exists()
        with self.path.open("a", newline="") as stream:
            writer = csv.DictWriter(stream, fieldnames=list(row))
            if fresh:
                writer.writeheader()
            writer.writerow(row)


def _remove(checkpoints: Path) -> None:
    for path in checkpoints.glob("*.ckpt"):
        path.unlink()
    checkpoints.rmdir()
