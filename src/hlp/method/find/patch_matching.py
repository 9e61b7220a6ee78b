"""The local patches of a frame, and the codebook entries nearest to them (paper, section 3.2).

Also the interface of learnt objects, wherever they are kept.
"""

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from hlp.arrays import Features, Pixels, grouped
from hlp.codebook.neighbours import is_joint
from hlp.method.find.trace import Observer, nobody
from hlp.method.settings import CoarseStage, FindSettings
from hlp.models.encoder import Encoder
from hlp.models.network import Network
from hlp.patches.local import cut_local_patches
from hlp.patches.sampling import join
from hlp.records import Codebook, Frame, LocalPatches, Matches, ObjectModel
from hlp.threads import ThreadTeam

_PER_THREAD = 128  # patches that are worth a thread of their own
_UNKNOWN, _NO_PATCH = -2, -1  # in place of the row of a pixel's patch


class LearntObjects(Protocol):
    """What detection needs from learnt objects. Each part is loaded when first needed."""

    @property
    def models(self) -> Mapping[int, ObjectModel]:
        """Object models by id."""

    @property
    def classes(self) -> Sequence[int]:
        """Object id of each class of the classifier, from class 1 on; class 0 is background."""

    def load_classifier(self) -> Network:
        """The classifier of holistic patches."""

    def load_encoder(self) -> Encoder:
        """The encoder of local patches."""

    def load_codebook(self, object_id: int) -> Codebook:
        """The codebook of one object."""

    def search_folder(self, object_ids: Sequence[int]) -> Path | None:
        """The folder in which the search in these objects' codebooks was prepared, if it was."""


def search_groups(
    models: Mapping[int, ObjectModel], object_ids: Iterable[int], settings: CoarseStage
) -> list[tuple[int, ...]]:
    """Objects that are searched in one index: each alone or, jointly, those of one patch size."""
    groups: dict[object, list[int]] = {}
    for object_id in sorted(object_ids):
        side = settings.local.side_of(models[object_id].local_size)
        groups.setdefault(side if is_joint(settings.codebook) else object_id, []).append(object_id)
    return [tuple(group) for group in groups.values()]


def load_codebooks(
    learnt: LearntObjects, object_ids: Sequence[int]
) -> tuple[list[Codebook], Features]:
    """The codebooks of some objects, and the features of all, of which each codebook's are a part.

    No more than one codebook's features are held twice.
    """
    if len(object_ids) == 1:
        codebook = learnt.load_codebook(object_ids[0])
        return [codebook], codebook.features
    codebooks: list[Codebook] = []
    features = np.zeros((0, 0), dtype=np.float32)
    for object_id in object_ids:
        codebook, first = learnt.load_codebook(object_id), len(features)
        count, dimension = codebook.features.shape
        features.resize((first + count, dimension), refcheck=False)
        features[first:] = codebook.features
        codebooks.append(replace(codebook, features=np.zeros((count, 0))))
    ends = np.cumsum([len(codebook.features) for codebook in codebooks])
    parts = np.split(features, ends[:-1])
    return [replace(c, features=part) for c, part in zip(codebooks, parts, strict=True)], features


class SearchGroup:
    """The codebooks of some objects and the search among the entries of all of them.

    `side` (m) is that of the objects' patches, `features` are those of all entries.
    """

    def __init__(
        self, learnt: LearntObjects, object_ids: Sequence[int], settings: FindSettings
    ) -> None:
        coarse, threads = settings.coarse, settings.machine.threads
        self.side = coarse.local.side_of(learnt.models[object_ids[0]].local_size)
        loaded, self.features = load_codebooks(learnt, object_ids)
        self.codebooks = {codebook.object_id: codebook for codebook in loaded}
        counts = [len(codebook.features) for codebook in loaded]
        self._first = dict(zip(self.codebooks, np.cumsum([0, *counts]).tolist(), strict=False))
        folder = learnt.search_folder(object_ids)
        self.search = coarse.codebook.build(self.features, settings.seed, threads, folder)

    def of_object(self, object_id: int, matches: Matches) -> Matches:
        """The matches with an object's own entries; those with others' are infinitely far."""
        first, count = self._first[object_id], len(self.codebooks[object_id].features)
        own = (matches.indices >= first) & (matches.indices < first + count)
        distances = np.where(own, matches.distances, np.float32(np.inf))
        return Matches(np.where(own, matches.indices - first, 0), distances)


class PatchMatching:
    """The search groups of the objects that may be looked for, each loaded when first needed."""

    def __init__(
        self,
        learnt: LearntObjects,
        settings: FindSettings,
        object_ids: Sequence[int],
        encoder: Callable[[], Encoder],
        team: ThreadTeam,
    ) -> None:
        self.settings, self.team, self.encoder = settings, team, encoder
        self.joint = is_joint(settings.coarse.codebook)
        self._learnt = learnt
        groups = search_groups(learnt.models, object_ids, settings.coarse)
        self._members = {object_id: group for group in groups for object_id in group}
        self._groups: dict[tuple[int, ...], SearchGroup] = {}
        self._lock = threading.Lock()

    def group(self, object_id: int) -> SearchGroup:
        """The group of an object. Several threads may ask for it at once."""
        members = self._members[object_id]
        with self._lock:
            if members not in self._groups:
                self._groups[members] = SearchGroup(self._learnt, members, self.settings)
            return self._groups[members]


class FrameMatches:
    """The patches of one frame and their nearest entries.

    A patch is cut, encoded and looked up once, for whichever look at an object first needs it, or
    for whichever of the objects that are searched jointly. Several threads may ask for patches at
    once.
    """

    def __init__(self, matching: PatchMatching, frame: Frame, observer: Observer = nobody) -> None:
        self._matching, self._frame, self._observer = matching, frame, observer
        self._known: dict[SearchGroup, _Known] = {}
        self._lock = threading.Lock()

    def share(self, pixels: Mapping[int, Pixels]) -> None:
        """Match the patches at the pixels (x, y) that objects need, by object; each patch once."""
        for group, object_ids in grouped(pixels, self._matching.group).items():
            parts = [pixels[object_id] for object_id in object_ids]
            self._looked_up_once(group, np.unique(np.concatenate(parts), axis=0))

    def match(self, object_id: int, pixels: Pixels) -> tuple[LocalPatches, Matches]:
        """The patches at those of the pixels (x, y) that have one, and their nearest entries."""
        group = self._matching.group(object_id)
        patches, matches = self._looked_up_once(group, pixels)
        return patches, group.of_object(object_id, matches)

    def _look_up(self, group: SearchGroup, pixels: Pixels) -> tuple[LocalPatches, Matches]:
        frame, settings = self._frame, self._matching.settings.coarse
        encoder = self._matching.encoder()
        self._observer("cut")
        cut = cut_local_patches(
            frame.rgb,
            frame.depth,
            frame.camera_matrix,
            pixels,
            group.side,
            settings.local,
            settings.grid.min_valid,
            encoder.sees_color,
            settings.grid.min_plane_deviation,
        )
        self._observer("encode")
        features = encoder.encode(cut)
        self._observer("search")
        return cut, group.search.search(features)

    def _looked_up_once(self, group: SearchGroup, pixels: Pixels) -> tuple[LocalPatches, Matches]:
        """What `_look_up` finds, where only new pixels are looked up."""
        x, y = pixels[:, 0], pixels[:, 1]
        with self._lock:
            if group not in self._known:
                self._known[group] = _Known(self._frame.depth.shape)
            known = self._known[group]
        with known.lock:
            missing = known.rows[y, x] == _UNKNOWN
            if missing.any() or not known.found:
                new, team = pixels[missing], self._matching.team
                at_once = team.threads if self._matching.joint else 1
                count = max(min(at_once, len(new) // _PER_THREAD), 1)
                parts = np.array_split(new, count)
                known.add(new, team.map(lambda part: self._look_up(group, parts[part]), count))
            rows = known.rows[y, x]
            patches, matches = known.found[0]
        rows = rows[rows != _NO_PATCH]
        return patches[rows], Matches(matches.indices[rows], matches.distances[rows])


class _Known:
    """The patches of a frame that were looked up so far, and the row (h, w) of each pixel's patch.

    `found` holds them all in one, or nothing yet.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.lock = threading.Lock()
        self.rows = np.full(shape, _UNKNOWN)
        self.found: list[tuple[LocalPatches, Matches]] = []

    def add(self, pixels: Pixels, found: Sequence[tuple[LocalPatches, Matches]]) -> None:
        """Add the patches that were cut at these pixels; not every pixel has one."""
        self.rows[pixels[:, 1], pixels[:, 0]] = _NO_PATCH
        row = sum(len(patches) for patches, _ in self.found)
        for patches, _ in found:
            x, y = np.rint(patches.pixels).astype(np.int64).T
            self.rows[y, x] = row + np.arange(len(patches))
            row += len(patches)
        everything = [*self.found, *found]
        patches = join([own for own, _ in everything])
        self.found = [(patches, join([own for _, own in everything]))]
