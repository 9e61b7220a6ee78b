"""The local patches of a frame, and the codebook entries nearest to them (paper, section 3.2)."""

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from hlp.codebook.neighbours import Neighbours, is_joint
from hlp.method.find.learnt_objects import LearntObjects
from hlp.method.stage_settings import CoarseStage, FindSettings
from hlp.models.encoder import Encoder
from hlp.observer import NOBODY, Observer
from hlp.patches.local import cut_local_patches, join_patches, take_patches
from hlp.records import Codebook, Frame, LocalPatches, Matches, ObjectModel
from hlp.thread_team import ThreadTeam

_PER_THREAD = 128  # patches that are worth a thread of their own
_UNKNOWN, _NO_PATCH = -2, -1  # in place of the row of a pixel's patch


def search_groups(
    models: Mapping[int, ObjectModel], object_ids: Iterable[int], settings: CoarseStage
) -> list[tuple[int, ...]]:
    """Objects that are searched in one index: each alone or, jointly, those of one patch size."""
    ids = sorted(object_ids)
    if not is_joint(settings.codebook):
        return [(object_id,) for object_id in ids]
    local = settings.local
    sizes = {each: local.side_of(models[each].local_size) for each in ids}
    return [tuple(i for i in ids if sizes[i] == size) for size in dict.fromkeys(sizes.values())]


def load_together(
    learnt: LearntObjects, object_ids: Sequence[int]
) -> tuple[list[Codebook], Float[np.ndarray, "m d"]]:
    """The codebooks of some objects, and the features of all, of which each codebook's are a part.

    No more than one codebook's features are held twice.
    """
    codebooks: list[Codebook] = []
    bounds = [0]
    together = np.zeros((0, 0), dtype=np.float32)
    for number, object_id in enumerate(object_ids):
        codebook = learnt.load_codebook(object_id)
        start, count = bounds[-1], len(codebook.features)
        if start + count > len(together):
            # Room for all others, if they are as large; what is not written takes no memory.
            rows = start + (len(object_ids) - number) * count
            room = np.empty((rows, codebook.features.shape[1]), dtype=np.float32)
            if start > 0:
                room[:start] = together[:start]
            together = room
        together[start : start + count] = codebook.features
        bounds.append(start + count)
        codebooks.append(replace(codebook, features=together[start : start + count]))
    parts = zip(codebooks, pairwise(bounds), strict=True)
    whole = together[: bounds[-1]]
    return [replace(each, features=whole[a:b]) for each, (a, b) in parts], whole


class SearchGroup:
    """The codebooks of some objects and the search among the entries of all of them.

    `side` (m) is that of the objects' patches, `features` are those of all entries.
    """

    def __init__(
        self, learnt: LearntObjects, object_ids: Sequence[int], settings: FindSettings
    ) -> None:
        local = settings.coarse.local
        own_size = learnt.models[object_ids[0]].local_size
        self.side = local.side_of(own_size)
        loaded, self.features = load_together(learnt, object_ids)
        self.codebooks = {each.object_id: each for each in loaded}
        counts = [len(each.features) for each in loaded]
        self._first = dict(zip(self.codebooks, np.cumsum([0, *counts]).tolist(), strict=False))
        folder = learnt.search_folder(object_ids)
        threads, seed = settings.machine.threads, settings.seed
        self.search: Neighbours = settings.coarse.codebook.build(
            self.features, seed, threads, folder
        )

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
        self.settings = settings
        self.team = team
        self.encoder = encoder
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

    Where objects are searched jointly, a patch is cut, encoded and looked up once, for whichever
    object first needs it. Several threads may ask for patches at once.
    """

    def __init__(self, matching: PatchMatching, frame: Frame, observer: Observer = NOBODY) -> None:
        self._observer = observer
        self._matching = matching
        self._frame = frame
        self._known: dict[SearchGroup, _Matched] = {}
        self._lock = threading.Lock()

    def share(self, pixels: Mapping[int, Int[np.ndarray, "n 2"]]) -> None:
        """Match the patches at the pixels (x, y) that objects need, by object; each patch once."""
        wanted: dict[SearchGroup, list[Int[np.ndarray, "n 2"]]] = {}
        for object_id, own in pixels.items():
            wanted.setdefault(self._matching.group(object_id), []).append(own)
        for group, parts in wanted.items():
            self._matched(group, np.unique(np.concatenate(parts), axis=0))

    def match(self, object_id: int, pixels: Int[np.ndarray, "n 2"]) -> tuple[LocalPatches, Matches]:
        """The patches at those of the pixels (x, y) that have one, and their nearest entries."""
        group = self._matching.group(object_id)
        if not is_joint(self._matching.settings.coarse.codebook):
            return self._look_up(group, pixels)
        known, rows = self._matched(group, pixels)
        assert known.patches is not None and known.matches is not None
        own = Matches(known.matches.indices[rows], known.matches.distances[rows])
        return take_patches(known.patches, rows), group.of_object(object_id, own)

    def _look_up(
        self, group: SearchGroup, pixels: Int[np.ndarray, "n 2"]
    ) -> tuple[LocalPatches, Matches]:
        frame, settings = self._frame, self._matching.settings.coarse
        encoder = self._matching.encoder()
        self._observer.enter("cut")
        cut = cut_local_patches(
            frame.rgb,
            frame.depth,
            frame.camera_matrix,
            pixels,
            group.side,
            settings.local,
            settings.grid.min_valid,
            encoder.sees_color,
            settings.grid.min_relief,
        )
        self._observer.enter("encode")
        features = encoder.encode(cut)
        self._observer.enter("search")
        return cut, group.search.search(features)

    def _look_up_by_threads(
        self, group: SearchGroup, pixels: Int[np.ndarray, "n 2"]
    ) -> tuple[LocalPatches, Matches]:
        """What `_look_up` finds, each thread with a part of the pixels."""
        team = self._matching.team
        count = max(min(team.threads, len(pixels) // _PER_THREAD), 1)
        parts = np.array_split(pixels, count)
        found = team.map(lambda number: self._look_up(group, parts[number]), count)
        indices = np.concatenate([matches.indices for _, matches in found])
        distances = np.concatenate([matches.distances for _, matches in found])
        return join_patches([cut for cut, _ in found]), Matches(indices, distances)

    def _matched(
        self, group: SearchGroup, pixels: Int[np.ndarray, "n 2"]
    ) -> tuple["_Matched", Int[np.ndarray, "m"]]:
        """What is known of a group, these pixels included, and the rows of their patches."""
        x, y = pixels[:, 0], pixels[:, 1]
        with self._lock:
            known = self._known.get(group) or _Matched.nothing(self._frame.depth.shape)
            missing = known.rows[y, x] == _UNKNOWN
            if missing.any() or group not in self._known:
                new = pixels[missing]
                known = known.with_more(new, *self._look_up_by_threads(group, new))
                self._known[group] = known
            rows = known.rows[y, x]
        return known, rows[rows != _NO_PATCH]


@dataclass(frozen=True)
class _Matched:
    """The patches of a frame that were matched so far, and the row (h, w) of each pixel's patch."""

    rows: Int[np.ndarray, "h w"]
    patches: LocalPatches | None
    matches: Matches | None

    @classmethod
    def nothing(cls, shape: tuple[int, ...]) -> "_Matched":
        """No patch of an image is matched yet."""
        return cls(np.full(shape, _UNKNOWN), None, None)

    def with_more(
        self, pixels: Int[np.ndarray, "n 2"], patches: LocalPatches, matches: Matches
    ) -> "_Matched":
        """With the patches that were cut at these pixels; not every pixel has one."""
        rows = self.rows.copy()
        rows[pixels[:, 1], pixels[:, 0]] = _NO_PATCH
        centers = np.rint(patches.pixels).astype(np.int64)
        before = 0 if self.patches is None else len(self.patches)
        rows[centers[:, 1], centers[:, 0]] = before + np.arange(len(patches))
        if self.patches is None or self.matches is None:
            return _Matched(rows, patches, matches)
        indices = np.concatenate([self.matches.indices, matches.indices])
        distances = np.concatenate([self.matches.distances, matches.distances])
        together = join_patches([self.patches, patches])
        return _Matched(rows, together, Matches(indices, distances))
