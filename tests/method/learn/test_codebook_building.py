"""One object's codebook: what its entries hold, and that blocks of views leave no trace."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from hlp.codebook.entries import EntrySettings
from hlp.data.synthetic.objects import demo_objects
from hlp.geometry import allocentric_to_egocentric
from hlp.method.learn import codebook_building as codebooks
from hlp.method.learn.codebook_building import build_codebook
from hlp.method.settings import CodebookStage
from hlp.patches.local import LocalSettings, plane_deviations
from hlp.records import Codebook
from hlp.rendering.views import ViewsSettings, render_views

PER_VIEW = 9
SETTINGS = CodebookStage(3, LocalSettings(8, 1.5, True), EntrySettings(patches_per_view=PER_VIEW))


class Depths:
    """An encoder whose feature is the patch's depth, so that it can be looked up again."""

    sees_color = False

    def encode(self, patches):
        return patches.depth.reshape(len(patches), -1).astype(np.float32)


@pytest.fixture(scope="module")
def model():
    return replace(next(iter(demo_objects().values())), local_size=0.04)


@pytest.fixture(scope="module")
def views(model):
    settings = ViewsSettings("numba", 12, "hemisphere", -10.0, 10.0, 2, 700.0, 300.0, 72)
    return render_views(model, settings, seed=1)


@pytest.fixture(scope="module")
def codebook(model, views):
    return build_codebook(model, views, Depths(), SETTINGS)


def test_entries_are_points_of_the_surface_in_their_views(codebook, model, views):
    assert codebook.object_id == model.object_id
    assert codebook.features.shape == (PER_VIEW * len(views), 64)
    surface = cKDTree(model.mesh.vertices)
    spacing = surface.query(model.mesh.vertices, k=2)[0][:, 1].max()
    assert surface.query(codebook.points_obj)[0].max() < spacing + 0.002
    for entry in range(0, len(codebook.features), 17):
        pose = views.poses_cam_obj[entry // PER_VIEW]
        ray = pose[:3, :3] @ codebook.points_obj[entry] + pose[:3, 3]
        expected = allocentric_to_egocentric(ray[None])[0].T @ pose[:3, :3]
        np.testing.assert_allclose(codebook.rotations_cam_obj[entry], expected, atol=1e-5)


@pytest.mark.parametrize("block", [1, 5, 7])
def test_blocks_leave_no_trace(block, codebook, model, views, monkeypatch):
    """A block may end anywhere, hold a single view or none of the sample for the scale."""
    monkeypatch.setattr(codebooks, "_SCALE_SAMPLE", 5)
    whole = build_codebook(model, views, Depths(), SETTINGS)
    assert whole.feature_scale != codebook.feature_scale
    monkeypatch.setattr(codebooks, "_BLOCK", block)
    again = build_codebook(model, views, Depths(), SETTINGS)
    for field in fields(Codebook):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(whole, field.name))


def test_entries_of_flat_patches_are_left_out(model, views):
    """Unless a view has no others."""
    wanted = 0.15
    for least, expected in ((wanted, wanted), (1.0, 0.0)):
        entries = EntrySettings(patches_per_view=PER_VIEW, min_plane_deviation=least)
        settings = CodebookStage(3, SETTINGS.local, entries)
        found = build_codebook(model, views, Depths(), settings)
        deviations = plane_deviations(found.features.reshape(-1, 8, 8))
        assert deviations.min() >= expected - 1e-4  # features are rounded
        assert PER_VIEW * len(views) * 0.7 < len(found.features) <= PER_VIEW * len(views)


def test_the_scale_is_the_distance_to_a_degraded_self(codebook):
    """Degraded patches lie nearer to their own entry than entries lie to each other."""
    features = codebook.features
    apart = np.median(np.linalg.norm(features - features[::-1], axis=1))
    assert 0.0 < codebook.feature_scale < apart
