"""The learning rate of a training: it rises, then falls to nothing (Smith and Topin 2019)."""

from pytorch_lightning.utilities.types import OptimizerLRScheduler
from torch.optim import Optimizer
from torch.optim.lr_scheduler import OneCycleLR


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
