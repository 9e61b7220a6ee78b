"""What the trainings of all networks have in common: AdamW, with one cycle of its rate."""

from typing import Generic, Protocol, TypeVar

import pytorch_lightning as pl
from pytorch_lightning.utilities.types import OptimizerLRScheduler
from torch import Tensor
from torch.optim import AdamW, Optimizer
from torch.optim.lr_scheduler import OneCycleLR


class _Rates(Protocol):
    @property
    def learning_rate(self) -> float: ...
    @property
    def weight_decay(self) -> float: ...


S = TypeVar("S", bound=_Rates)


class OneCycleModule(pl.LightningModule, Generic[S]):
    """A network in training; the rate rises during the first share `rise` of all steps."""

    def __init__(self, settings: S, rise: float) -> None:
        super().__init__()
        self.settings = settings
        self.rise = rise

    def adamw(self) -> AdamW:
        """The optimizer of all parameters, at its highest rate."""
        rate, decay = self.settings.learning_rate, self.settings.weight_decay
        return AdamW(self.parameters(), lr=rate, weight_decay=decay)

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """AdamW with one cycle over the whole training."""
        steps = self.trainer.estimated_stepping_batches
        return one_cycle(self.adamw(), self.settings.learning_rate, steps, self.rise)

    def log_means(self, values: dict[str, Tensor], batch_size: int | None = None) -> None:
        """Log the means over each epoch."""
        self.log_dict(values, on_step=False, on_epoch=True, batch_size=batch_size)


def one_cycle(
    optimizer: Optimizer, learning_rate: float, steps: float, rise: float
) -> OptimizerLRScheduler:
    """The optimizer with one cycle over all `steps`: up to the rate, then down to nothing.

    `rise` is the share of the steps in which the rate rises.
    """
    if rise * int(steps) == 1.0:  # OneCycleLR would divide by the length of the rise, 0
        rise *= 2.0
    schedule = OneCycleLR(optimizer, learning_rate, total_steps=int(steps), pct_start=rise)
    return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}
