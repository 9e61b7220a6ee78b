"""Local patches of a frame that several objects share, and the entries nearest to them."""

import threading
import time
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from hlp.codebook.neighbours import ExactNeighbours
from hlp.data.synthetic.objects import demo_objects
from hlp.method.find.patch_matching import FrameMatches, PatchMatching, SearchGroup, search_groups
from hlp.method.settings import FindSettings
from hlp.patches.region import region_pixels
from hlp.records import Codebook
from hlp.threads import ThreadTeam
from tiny_method import tiny_method

OWN, JOINT, SHARED = (
    FindSettings.of(tiny_method(*overrides))
    for overrides in (
        ("codebook=exact",),
        ("codebook=joint_lists",),
        ("codebook=joint_lists", "patches.local.size_mm=45"),
    )
)
MODELS = dict(list(demo_objects().items())[:3])
DIMENSION = 16


class Encoder:
    """Random projections of the depth; counts the patches that it has seen."""

    sees_color = False

    def __init__(self):
        self.seen = 0
        self._lock = threading.Lock()

    def encode(self, patches):
        with self._lock:
            self.seen += len(patches)
        size = patches.depth.shape[1] ** 2
        projections = np.random.default_rng(5).normal(size=(DIMENSION, size))
        flat = patches.depth.reshape(len(patches), size).astype(np.float64)
        # BLAS orders sums by the number of patches.
        return np.asarray(np.einsum("ns,ds->nd", flat, projections), dtype=np.float32)


class Learnt:
    """Codebooks of 40 entries and more, at the features of nothing in particular."""

    models = MODELS

    def load_codebook(self, object_id):
        rng = np.random.default_rng(object_id)
        count = 40 + object_id
        features = rng.normal(scale=20.0, size=(count, DIMENSION)).astype(np.float32)
        rotations = np.tile(np.eye(3, dtype=np.float32), (count, 1, 1))
        return Codebook(object_id, features, rotations, np.zeros((count, 3), np.float32), 1.0)

    def search_folder(self, object_ids):
        return None


def matching(settings, encoder):
    learnt = Learnt()
    return PatchMatching(learnt, settings, tuple(MODELS), lambda: encoder, ThreadTeam(2))


def matches_of(frame, encoder=None, settings=SHARED):
    return FrameMatches(matching(settings, encoder or Encoder()), frame)


def regions(frame):
    """Pixels of three regions that overlap, in no order."""
    rng = np.random.default_rng(1)
    parts = []
    for left in (60, 100, 130):
        mask = np.zeros(frame.depth.shape, dtype=bool)
        mask[60:180, left : left + 120] = True
        parts.append(rng.permutation(region_pixels(mask, 8)))
    return parts


def test_each_object_is_searched_alone_or_with_those_of_the_same_patch_size():
    ids = list(MODELS)
    assert search_groups(MODELS, reversed(ids), OWN.coarse) == [(i,) for i in ids]
    assert search_groups(MODELS, reversed(ids), SHARED.coarse) == [tuple(ids)]
    sizes = dict(zip(ids, (0.03, 0.04, 0.03), strict=True))
    models = {i: replace(MODELS[i], local_size=sizes[i]) for i in ids}
    assert search_groups(models, ids, JOINT.coarse) == [(ids[0], ids[2]), (ids[1],)]


def test_a_patch_votes_for_the_objects_of_its_nearest_entries_alone(frame):
    """Beside the distances to all entries of all objects, by NumPy."""
    encoder = Encoder()
    frame_matches = matches_of(frame, encoder)
    (pixels, *_) = regions(frame)
    codebooks = {i: Learnt().load_codebook(i).features for i in MODELS}
    voters = 0
    for object_id, features in codebooks.items():
        patches, found = frame_matches.match(object_id, pixels)
        queries = encoder.encode(patches)
        everything = np.concatenate(list(codebooks.values()))
        nearest = np.sort(np.linalg.norm(everything - queries[:, None], axis=2), axis=1)[:, :3]
        own = np.linalg.norm(features[found.indices] - queries[:, None], axis=2)
        votes = np.isfinite(found.distances)
        np.testing.assert_allclose(found.distances[votes], own[votes], rtol=1e-3)
        np.testing.assert_allclose(found.distances[votes], nearest[votes], rtol=1e-3)
        voters += np.count_nonzero(votes)
    assert voters == 3 * len(patches)


def assert_same(found, expected):
    for one, other in zip(found, expected, strict=True):
        for name in vars(one):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def places(found):
    return len(np.unique(np.concatenate([patches.pixels for patches, _ in found]), axis=0))


def test_a_further_look_at_one_object_encodes_only_what_is_new(frame):
    first, second, _ = regions(frame)
    encoder = Encoder()
    of_frame = matches_of(frame, encoder, OWN)
    found = [of_frame.match(next(iter(MODELS)), pixels) for pixels in (first, second)]
    assert encoder.seen == places(found) < sum(len(patches) for patches, _ in found)
    assert_same(found[1], matches_of(frame, settings=OWN).match(next(iter(MODELS)), second))


@pytest.mark.parametrize("shared_first", [False, True])
def test_each_patch_is_cut_once_and_is_what_it_would_be_alone(shared_first, frame):
    encoder = Encoder()
    of_frame = matches_of(frame, encoder)
    asked = dict(zip(MODELS, regions(frame), strict=True))
    if shared_first:
        of_frame.share(asked)
    found = {i: of_frame.match(i, pixels) for i, pixels in asked.items()}
    assert encoder.seen == places([*found.values()]) < sum(len(p) for p, _ in found.values())
    for object_id, pixels in asked.items():
        assert_same(found[object_id], matches_of(frame).match(object_id, pixels))


def test_a_group_is_loaded_once_for_all_threads(monkeypatch):
    shared = matching(SHARED, Encoder())
    load = Learnt.load_codebook

    def load_slowly(self, object_id):
        time.sleep(0.02)
        return load(self, object_id)

    monkeypatch.setattr(Learnt, "load_codebook", load_slowly)
    groups = ThreadTeam(6).map(lambda number: shared.group(list(MODELS)[number % 3]), 6)
    assert all(group is groups[0] for group in groups)


def test_threads_may_ask_at_once(frame):
    encoder, parts = Encoder(), regions(frame)
    of_frame = matches_of(frame, encoder)
    alone = [matches_of(frame).match(1, pixels) for pixels in parts]
    found = ThreadTeam(12).map(lambda number: of_frame.match(1, parts[number % 3]), 12)
    for number, one in enumerate(found):
        assert_same(one, alone[number % 3])
    assert encoder.seen == places(alone)


def test_no_pixels_and_pixels_without_depth_have_no_patches(frame):
    empty = matches_of(replace(frame, depth=0.0 * frame.depth))
    for pixels in (np.zeros((0, 2), dtype=np.int64), np.array([[50, 60], [58, 60]])):
        patches, matches = empty.match(1, pixels)
        assert len(patches) == len(matches.indices) == 0


@dataclass(frozen=True)
class DocumentedCodebook:
    """What the protocol `NeighboursSettings` asks for, and nothing else."""

    name: str = "documented"
    neighbours: int = 3
    dimension_multiple: ClassVar[int] = 1

    def build(self, features, seed, threads, folder=None):
        return ExactNeighbours(features, self.neighbours)

    def prepare(self, features, seed, folder):
        raise AssertionError("nothing is prepared")


def test_a_codebook_of_ones_own_needs_the_documented_protocol_alone(frame):
    own = replace(OWN, coarse=replace(OWN.coarse, codebook=DocumentedCodebook()))
    (pixels, *_) = regions(frame)
    found, expected = (matches_of(frame, None, some).match(1, pixels) for some in (own, OWN))
    assert len(found[0]) > 0
    assert_same(found, expected)


@pytest.mark.parametrize(("size_mm", "side"), [(None, 0.038 * 1.5), (45.0, 0.045 * 1.5)])
def test_patches_are_cut_at_the_side_that_settings_tell(size_mm, side, monkeypatch):
    """An object's own size of 38 mm makes patches of 57 mm."""
    models = {i: replace(model, local_size=0.038) for i, model in MODELS.items()}
    monkeypatch.setattr(Learnt, "models", models)
    local = replace(OWN.coarse.local, size_mm=size_mm)
    settings = replace(OWN, coarse=replace(OWN.coarse, local=local))
    assert matching(settings, Encoder()).group(1).side == pytest.approx(side)


def test_features_are_held_once():
    group = SearchGroup(Learnt(), tuple(MODELS), SHARED)
    for object_id, codebook in group.codebooks.items():
        assert np.shares_memory(codebook.features, group.features)
        np.testing.assert_array_equal(codebook.features, Learnt().load_codebook(object_id).features)
    assert len(group.features) == sum(len(book.features) for book in group.codebooks.values())
