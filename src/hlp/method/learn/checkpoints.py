"""Checkpoints of a training: written whole, verified before use, and read as tensors alone."""

import csv
import io
import logging
import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytorch_lightning as pl
import torch
from lightning_fabric.plugins import CheckpointIO
from pytorch_lightning.callbacks import Checkpoint

from hlp.checksums import content_checksum
from hlp.errors import DataError
from hlp.files import replaced

if TYPE_CHECKING:
    from torch import Tensor

_KEPT = 2
_ENDING = ".ckpt"


class CheckpointFiles(CheckpointIO):
    """Files of checkpoints: a line with the checksum of what follows, then torch's file.

    They are written beside their final name and renamed. Lightning would write them into the
    system's folder for temporary files, from where a move can be cut off half-way. They are read
    with `weights_only`, so a file that somebody else has written runs no code.
    """

    def save_checkpoint(
        self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None
    ) -> None:
        """Write a checkpoint, whole or not at all."""
        content = io.BytesIO()
        torch.save(checkpoint, content)
        with replaced(Path(path)) as stream:
            stream.write(content_checksum(content.getbuffer()).encode() + b"\n")
            stream.write(content.getbuffer())

    def load_checkpoint(
        self, path: str | Path, map_location: Any = "cpu", weights_only: bool | None = True
    ) -> dict[str, Any]:
        """Read a checkpoint. Raises DataError naming a damaged file."""
        checksum, _, content = Path(path).read_bytes().partition(b"\n")
        if content_checksum(content).encode() != checksum:
            raise DataError(f"{path} is damaged")
        try:
            loaded = torch.load(io.BytesIO(content), map_location=map_location, weights_only=True)
        except (pickle.UnpicklingError, RuntimeError, EOFError) as error:
            raise DataError(f"{path} is no checkpoint of HLP") from error
        if not isinstance(loaded, dict):
            raise DataError(f"{path} is no checkpoint of HLP")
        return loaded

    def remove_checkpoint(self, path: str | Path) -> None:
        """Remove a checkpoint, if it is there."""
        Path(path).unlink(missing_ok=True)


class EpochCheckpoints(Checkpoint):
    """Writes a checkpoint after every epoch, and keeps the last two."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def on_train_epoch_end(self, trainer: pl.Trainer, _: pl.LightningModule) -> None:
        """Write the checkpoint of an epoch."""
        trainer.save_checkpoint(self.folder / f"epoch-{trainer.current_epoch:06d}{_ENDING}")
        if trainer.is_global_zero:
            for old in _checkpoints(self.folder)[:-_KEPT]:
                old.unlink()

    def remove(self) -> None:
        """Remove all checkpoints, and what a killed process had begun to write."""
        for path in self.folder.glob("*"):
            path.unlink()
        self.folder.rmdir()


def last_checkpoint(folder: Path) -> Path | None:
    """The last sound checkpoint, if there is one; damaged ones after it are removed."""
    for path in reversed(_checkpoints(folder)):
        try:
            CheckpointFiles().load_checkpoint(path)
        except DataError as error:
            logging.getLogger(__name__).warning("%s: training starts from an earlier epoch", error)
            path.unlink()
        else:
            return path
    return None


def _checkpoints(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"epoch-*{_ENDING}"))


HISTORY = "history.csv"
WEIGHTS = "weights.safetensors"


@dataclass(frozen=True)
class StartingWeights:
    """A classifier of fewer objects to start from: its weights, and the new labels of its classes.

    It is trained further for `epochs`.
    """

    weights: Mapping[str, "Tensor"]
    labels: Mapping[int, int]
    epochs: int


def read_weights(folder: Path) -> dict[str, "Tensor"]:
    """A network's weights by name. Raises FileNotFoundError if there are none."""
    from safetensors.torch import load_file

    return load_file(folder / WEIGHTS)


def read_history(folder: Path) -> list[dict[str, float]]:
    """Metrics of every epoch, in order; empty if nothing was trained. Raises DataError."""
    path = folder / HISTORY
    if not path.exists():
        return []
    rows: list[dict[str, float]] = []
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            for row in csv.DictReader(stream):
                rows.append({name: float(value) for name, value in row.items()})
    except (ValueError, TypeError, csv.Error) as error:
        where = f"{path}, line {len(rows) + 2}"
        raise DataError(f"{where}: no metrics of an epoch ({error})") from error
    return rows
