"""What a search over a frame found on its way, for each object; who is told how far it is."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from hlp.records import Hypotheses, LocalPatches, Region, Votes
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.pose_fit import PoseFit

Stage = Literal["regions", "hypotheses", "poses"]
STAGES: tuple[Stage, ...] = ("regions", "hypotheses", "poses")
"""The stages of a search, in their order."""
STEPS = ("holistic", "local", "voting", "refinement")
"""Steps whose time is measured; the stage `hypotheses` has two of them."""


@dataclass(frozen=True)
class ObjectTrace:
    """The search for one object in one frame; what was not reached or not kept is None.

    `region` is where the search began, `patches`, `votes` and `hypotheses` are those of this
    region. `refined` are all refined hypotheses, with the chosen ones; None if there was nothing to
    refine. `fits` tell how well each of the chosen `instances` fits the frame, which its score is
    computed from. `seconds` is the wall time of each of the `STEPS`.
    """

    region: Region | None = None
    patches: LocalPatches | None = None
    votes: Votes | None = None
    hypotheses: Hypotheses | None = None
    refined: RefinedHypotheses | None = None
    fits: tuple[PoseFit, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)


Trace = Mapping[int, ObjectTrace]
"""The search for each object in one frame, by the object's id."""


Observer = Callable[[str], None]
"""Is told of each part of a search as it begins, for example to measure its time.

The parts are windows, network, region (stage 1), cut, encode, search, vote, modes (stage 2),
templates, screen, refine, verify and second_search (stage 3).
"""


def nobody(part: str) -> None:
    """An observer that does nothing."""
