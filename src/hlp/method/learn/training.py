"""Trains a Lightning module in a folder: resumable, with a history, quiet without a terminal."""

import ctypes
import gc
import io
import logging
import pickle
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytorch_lightning as pl
import torch
from lightning_fabric.plugins import CheckpointIO
from pytorch_lightning.callbacks import Checkpoint
from safetensors.torch import save
from torch import Tensor, nn

from hlp.errors import DataError
from hlp.files import replaced, write_csv
from hlp.fingerprints import content_checksum
from hlp.method.learn.model_files import HISTORY, WEIGHTS
from hlp.method.settings import TrainerSettings
from hlp.progress import Progress

_CHECKPOINTS, _PATTERN = "checkpoints", "epoch-*.ckpt"
_KEPT = 2  # checkpoints
_CALIBRATION = 1024  # images
_INTENDED = (
    # Batches come from memory, so worker processes would only copy them.
    ".*does not have many workers.*",
    ".*val_dataloader.*",
    ".*exists and is not empty.*",  # a resumed training finds its checkpoint there
    ".*GPU available but not used.*",  # `trainer.accelerator` decides
    ".*LeafSpec.*",  # between Lightning and torch
)


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
    checkpoints = folder / _CHECKPOINTS
    last = last_checkpoint(checkpoints)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    free_memory()  # what making the data has taken
    with _quiet():
        engine = _make_trainer(trainer, epochs, folder)
        with _stops(engine):
            engine.fit(module, data, ckpt_path=last, weights_only=True)
    weights = {name: value.contiguous() for name, value in network.state_dict().items()}
    with replaced(folder / WEIGHTS) as stream:  # its errors are the system's, unlike safetensors'
        stream.write(save(weights))
    for path in checkpoints.glob("*"):  # also what a killed process had begun to write
        path.unlink()
    checkpoints.rmdir()


def _make_trainer(trainer: TrainerSettings, epochs: int, folder: Path) -> pl.Trainer:
    return pl.Trainer(
        accelerator=trainer.accelerator,
        devices=trainer.devices,
        strategy=trainer.strategy,
        precision=trainer.precision,
        max_epochs=epochs,
        use_distributed_sampler=False,  # our loaders divide the batches themselves
        callbacks=[_Epochs(folder, trainer.torch_threads)],
        plugins=[CheckpointFiles()],
        logger=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        default_root_dir=folder,
    )


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress Lightning's tips, and warnings about things that are intended."""
    logging.getLogger("pytorch_lightning").setLevel(logging.WARNING)
    with warnings.catch_warnings():
        for message in _INTENDED:
            warnings.filterwarnings("ignore", message=message)
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


def free_memory() -> None:
    """Collect garbage, and give what is free back to the system, which glibc alone would keep.

    Elsewhere than under glibc, only the first.
    """
    gc.collect()
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


def calibration_images(data: pl.LightningDataModule, images_of: Callable[[Any], Tensor]) -> Tensor:
    """Images of the first training batches, enough to measure the ranges of activations."""
    found: list[Tensor] = []
    for batch in data.train_dataloader():
        # Degraded like the batch that would come next in training.
        found.append(images_of(data.on_before_batch_transfer(batch, 0)))
        if sum(len(images) for images in found) >= _CALIBRATION:
            break
    return torch.cat(found)[:_CALIBRATION]


class _Epochs(Checkpoint):
    """After every epoch: its metrics in the history, and a checkpoint, of which two are kept.

    Each checkpoint contains the rows so far (Lightning's CSVLogger deletes those before when a
    training is resumed) and torch's random state, from which dropout draws. The latter is restored
    before Lightning makes the epoch's batches, which draws random numbers too. The first of several
    processes, to which this is sent, shows how far it is.
    """

    def __init__(self, folder: Path, threads: int) -> None:
        self.folder, self.threads = folder, threads
        self.progress: Progress | None = None
        self.rows: list[dict[str, float]] = []

    def setup(self, trainer: pl.Trainer, pl_module: pl.LightningModule, stage: str) -> None:
        torch.set_num_threads(self.threads)  # in every training process: it changes the last bits
        if trainer.is_global_zero:
            what = f"training {type(pl_module).__name__}"
            self.progress = Progress(None, what, trainer.max_epochs, unit="epoch")

    def teardown(self, trainer: pl.Trainer, pl_module: pl.LightningModule, stage: str) -> None:
        self._end()

    def on_exception(self, trainer: pl.Trainer, pl_module: pl.LightningModule, _: Any) -> None:
        self._end()

    def _end(self) -> None:
        if self.progress is not None:
            self.progress.close()
        self.progress = None  # it cannot be sent back to the process that has begun

    def on_train_epoch_end(self, trainer: pl.Trainer, _: pl.LightningModule) -> None:
        metrics = {name: float(value) for name, value in sorted(trainer.callback_metrics.items())}
        self.rows.append({"epoch": trainer.current_epoch, **metrics})
        self._write_history(trainer)
        if self.progress is not None:
            self.progress.update(trainer.current_epoch + 1 - self.progress.n)
        folder = self.folder / _CHECKPOINTS
        trainer.save_checkpoint(folder / _PATTERN.replace("*", f"{trainer.current_epoch:06d}"))
        if trainer.is_global_zero:
            for old in sorted(folder.glob(_PATTERN))[:-_KEPT]:
                old.unlink()

    def on_fit_end(self, trainer: pl.Trainer, _: pl.LightningModule) -> None:
        self._write_history(trainer)  # also if a resumed training had no epoch left

    def _write_history(self, trainer: pl.Trainer) -> None:
        if self.rows and trainer.is_global_zero:
            columns = list(self.rows[0])
            rows = [[row[name] for name in columns] for row in self.rows]
            write_csv(self.folder / HISTORY, columns, rows)

    def state_dict(self) -> dict[str, Any]:
        return {"rows": self.rows, "torch": torch.get_rng_state()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.rows = list(state["rows"])
        torch.set_rng_state(state["torch"])


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
            return dict(torch.load(io.BytesIO(content), map_location, weights_only=True))
        except (pickle.UnpicklingError, RuntimeError, EOFError, TypeError, ValueError) as error:
            raise DataError(f"{path} is not a checkpoint of HLP") from error

    def remove_checkpoint(self, path: str | Path) -> None:
        """Remove a checkpoint, if it is there."""
        Path(path).unlink(missing_ok=True)


def last_checkpoint(folder: Path) -> Path | None:
    """The last sound checkpoint, if there is one; damaged ones after it are removed."""
    for path in sorted(folder.glob(_PATTERN), reverse=True):
        try:
            CheckpointFiles().load_checkpoint(path)
        except DataError as error:
            logging.getLogger(__name__).warning("%s: training starts from an earlier epoch", error)
            path.unlink()
        else:
            return path
    return None
