from dataclasses import replace

import numpy as np
import pytest

from hlp.data.synthetic import scenes as synthetic_scenes
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import LINEMOD_CAMERA, SyntheticScenes, SyntheticSettings
from hlp.records import Frame
from hlp.rendering.rasterizer import render_depth


def demo_settings(**changes: object) -> SyntheticSettings:
    return replace(SyntheticSettings(), **{"width": 320, "height": 240, **changes})


def same(first: Frame, second: Frame) -> bool:
    return np.array_equal(first.rgb, second.rgb) and np.array_equal(first.depth, second.depth)


@pytest.fixture(scope="module")
def source() -> SyntheticScenes:
    return SyntheticScenes(demo_settings(scenes=6, noise=0.0))


def test_frames_carry_their_keys_and_linemods_camera(source: SyntheticScenes) -> None:
    assert len(source.keys) == 6
    frame = source.load(source.keys[2])
    assert frame.key == source.keys[2]
    assert frame.rgb.shape == (240, 320, 3)
    assert frame.depth.dtype == np.float32
    np.testing.assert_allclose(frame.camera_matrix[:2], LINEMOD_CAMERA[:2] / 2)
    with pytest.raises(KeyError, match="no synthetic frame"):
        source.load("000099_000000")


def test_a_mask_shows_the_object_alone_and_beside_it_what_is_nearer(
    source: SyntheticScenes,
) -> None:
    frame, checked = source.load(source.keys[0]), 0
    for target in frame.targets:
        mesh, camera = demo_objects()[target.object_id].mesh, frame.camera_matrix
        alone = render_depth(mesh, target.pose_cam_obj[None], camera, (240, 320))[0]
        seen = source.visible_mask(frame, target)
        np.testing.assert_allclose(frame.depth[seen], alone[seen], atol=1e-5)
        occluded = (alone > 0) & ~seen
        assert (frame.depth[occluded] <= alone[occluded] + 1e-4).all()
        assert occluded.any() or target.visible_fraction == 1.0
        checked += int(seen.sum())
    assert checked > 2000


def test_visible_fraction_counts_what_others_and_the_border_hide(source: SyntheticScenes) -> None:
    fractions, listed = [], 0
    for key in source.keys[:3]:
        scene = source.scene(key)
        targets = {t.object_id: t for t in source.load(key).targets}
        for number, item in enumerate(scene.items):
            if item.object_id == 0:
                continue
            margin = 400  # a far larger image around the same view: nothing is cut off
            wide = source.camera_matrix + np.array([[0, 0, margin], [0, 0, margin], [0, 0, 0]])
            shape = (240 + 2 * margin, 320 + 2 * margin)
            pose = scene.pose_cam_obj(number)
            full = np.count_nonzero(render_depth(item.mesh, pose[None], wide, shape)[0])
            expected = np.count_nonzero(scene.index == number) / full
            assert (item.object_id in targets) == (expected >= 0.3)
            if item.object_id in targets:
                listed += 1
                assert targets[item.object_id].visible_fraction == pytest.approx(expected, rel=0.01)
                fractions.append(expected)
    assert listed >= 9
    assert min(fractions) < 0.8 < max(fractions)


def test_frames_depend_on_seed_and_number_only() -> None:
    settings = demo_settings(scenes=3)
    first, second = SyntheticScenes(settings), SyntheticScenes(replace(settings, scenes=9))
    last = first.load(first.keys[2])
    assert same(last, second.load(second.keys[2]))
    np.testing.assert_array_equal(
        last.targets[0].pose_cam_obj, second.load(second.keys[2]).targets[0].pose_cam_obj
    )
    assert not same(last, first.load(first.keys[1]))
    other = SyntheticScenes(replace(settings, seed=1))
    assert not same(last, other.load(other.keys[2]))


def test_frames_made_are_kept_and_the_oldest_forgotten(
    source: SyntheticScenes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(synthetic_scenes, "_CACHED", 1)
    fresh = SyntheticScenes(source.settings)
    first, second = fresh.keys[:2]
    made = fresh.load(first)
    assert fresh.load(first) is made
    fresh.load(second)
    again = fresh.load(first)
    assert again is not made
    np.testing.assert_array_equal(again.rgb, made.rgb)
    np.testing.assert_array_equal(again.depth, made.depth)


def test_identity_follows_settings_and_kind() -> None:
    settings = demo_settings(scenes=3)
    identities = {
        SyntheticScenes(settings).identity(),
        SyntheticScenes(replace(settings, seed=1)).identity(),
        SyntheticScenes(replace(settings, noise=0.5)).identity(),
        SyntheticScenes(settings, targets=False).identity(),
    }
    assert len(identities) == 4
    assert SyntheticScenes(demo_settings(scenes=3)).identity() in identities


def test_training_frames_hold_no_target() -> None:
    frames = SyntheticScenes(SyntheticSettings(scenes=3, seed=5), targets=False)
    assert len(frames.keys) == 3
    scene = frames.scene(frames.keys[0])
    assert all(item.object_id == 0 for item in scene.items)
    assert frames.load(frames.keys[0]).targets == ()
    assert len(np.unique(scene.index)) > 6


def test_noise_makes_depth_incomplete_and_rough() -> None:
    clean = SyntheticScenes(demo_settings(scenes=1, noise=0.0))
    noisy = SyntheticScenes(demo_settings(scenes=1, noise=1.0))
    true, read = clean.load(clean.keys[0]).depth, noisy.load(noisy.keys[0]).depth
    assert 0.01 < ((read == 0) & (true > 0)).mean() < 0.2
    both = (read > 0) & (true > 0)
    assert 0.0005 < np.median(np.abs(read[both] - true[both])) < 0.006


def test_a_smaller_image_has_the_same_errors_of_depth() -> None:
    """Away from edges, which are more pixels of a smaller image."""
    errors = {}
    for width in (640, 320):
        clean, noisy = (
            SyntheticScenes(SyntheticSettings(scenes=1, width=width, noise=noise))
            for noise in (0.0, 1.0)
        )
        true, read = (frames.load(frames.keys[0]).depth for frames in (clean, noisy))
        assert true.shape == (width * 3 // 4, width)
        both = (read > 0) & (true > 0) & (np.abs(true - read) < 0.01)
        errors[width] = np.std((true - read)[both])
    assert errors[320] == pytest.approx(errors[640], rel=0.1)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"min_visible": 0.0}, "min_visible"),
        ({"objects": (0, 3)}, "objects"),
        ({"objects": (4, 9)}, "objects"),
        ({"distance_mm": (900.0, 600.0)}, "distance_mm"),
        ({"elevation_deg": (20.0,)}, "elevation_deg"),
        ({"width": 0}, "width"),
    ],
)
def test_settings_that_make_no_scene_are_refused_by_name(
    change: dict[str, object], name: str
) -> None:
    with pytest.raises(ValueError, match=name):
        SyntheticScenes(demo_settings(**change))
