"""The alternatives of search, voting and refinement that the settings name."""

import numpy as np
from jaxtyping import Float, UInt8

from hlp.codebook.inverted_lists import InvertedLists, InvertedListsSettings
from hlp.codebook.neighbours import ExactNeighbours, ExactSettings, KdForest, Neighbours
from hlp.method.settings import RefinementSettings, SearchIndexSettings, VotingSettings
from hlp.refinement.icp import IcpRefiner, IcpSettings
from hlp.refinement.none import NoneRefiner
from hlp.refinement.pso import PsoRefiner, PsoSettings
from hlp.refinement.refiner import Refiner
from hlp.voting.modes import JointModes, JointVotingSettings, ModeFinder, PaperModes


def make_neighbours(
    features: Float[np.ndarray, "m d"],
    settings: SearchIndexSettings,
    seed: int,
    lists: UInt8[np.ndarray, "bytes"] | None = None,
) -> Neighbours:
    """The search index over a codebook's features; `lists` are trained ones, see `load_lists`."""
    if isinstance(settings, ExactSettings):
        return ExactNeighbours(features, settings.neighbours)
    if isinstance(settings, InvertedListsSettings):
        return InvertedLists(features, settings, seed, lists)
    return KdForest(features, settings.neighbours, settings.trees, settings.checks, seed)


def make_mode_finder(settings: VotingSettings, threads: int) -> ModeFinder:
    """Joint modes, or the paper's independent ones."""
    if isinstance(settings, JointVotingSettings):
        return JointModes(settings, threads)
    return PaperModes(settings)


def make_refiner(settings: RefinementSettings) -> Refiner:
    """PSO (the paper's), ICP or none."""
    if isinstance(settings, PsoSettings):
        return PsoRefiner(settings)
    if isinstance(settings, IcpSettings):
        return IcpRefiner(settings)
    return NoneRefiner()
