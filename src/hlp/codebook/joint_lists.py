"""One index for the entries of all objects: a patch is looked up once, and votes once (D)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le
from jaxtyping import Float

from hlp.codebook.inverted_lists import InvertedLists, InvertedListsSettings
from hlp.codebook.neighbours import SEARCHES
from hlp.settings import Doc, Settings

_ENTRIES = 450  # in a list: as in the lists of one object's 57,600 entries


@SEARCHES.register
@dataclass(frozen=True)
class JointListsSettings(Settings):
    """Config group `codebook`: inverted lists of all objects whose patches have one size (D).

    A patch votes for the objects of its nearest entries alone: one that shows an object hardly ever
    votes for another. Set `patches.local.size_mm`, so that the patches of all objects have one
    size; otherwise only objects that happen to have the same size share an index.
    """

    name: Literal["joint_lists"] = "joint_lists"
    neighbours: Annotated[
        int, Ge(1), Le(1000), Doc("nearest entries, of any object, of each patch that vote (D)")
    ] = 3
    lists: Annotated[
        int,
        Ge(1),
        Doc(f"largest number of lists; with fewer entries there is one for {_ENTRIES} (D)"),
    ] = 1024
    probes: Annotated[int, Ge(1), Doc("number of nearest lists that are searched (D)")] = 16
    candidates: Annotated[
        int, Ge(1), Doc("entries compared by their whole features, for each neighbour (D)")
    ] = 8

    dimension_multiple: ClassVar[int] = InvertedListsSettings.dimension_multiple
    joint: ClassVar[bool] = True

    def build(
        self,
        features: Float[np.ndarray, "m d"],
        seed: int,
        threads: int,
        folder: Path | None = None,
    ) -> InvertedLists:
        """The lists, read from the folder if it holds them, otherwise trained with the seed."""
        return self._lists_for(len(features)).build(features, seed, threads, folder)

    def prepare(self, features: Float[np.ndarray, "m d"], seed: int, folder: Path) -> None:
        """Train the lists and write them into the folder."""
        self._lists_for(len(features)).prepare(features, seed, folder)

    def _lists_for(self, entries: int) -> InvertedListsSettings:
        lists = min(self.lists, max(entries // _ENTRIES, 1))
        return InvertedListsSettings(
            "inverted_lists", self.neighbours, lists, self.probes, self.candidates
        )
