"""The refiner that the configuration names."""

from hlp.config.settings import RunSettings
from hlp.refinement.icp import IcpRefiner, IcpSettings
from hlp.refinement.none import NoneRefiner
from hlp.refinement.pso import PsoRefiner, PsoSettings
from hlp.refinement.refiner import Refiner


def make_refiner(settings: RunSettings) -> Refiner:
    """PSO (the paper's), ICP or none."""
    refinement = settings.refinement
    if isinstance(refinement, PsoSettings):
        return PsoRefiner(refinement)
    if isinstance(refinement, IcpSettings):
        return IcpRefiner(refinement)
    return NoneRefiner()
