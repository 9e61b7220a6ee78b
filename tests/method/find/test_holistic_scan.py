import dataclasses

import cv2
import numpy as np
import pytest
import torch

from hlp.data.synthetic.objects import demo_objects
from hlp.geometry import project
from hlp.method.find.holistic_scan import (
    FrameWindows,
    HolisticScan,
    checkerboard,
    find_planes,
    group_sizes,
    off_planes,
)
from hlp.models.network import load_network
from hlp.models.network_training import HolisticCNN
from hlp.models.onnx_export import export_network
from hlp.patches.holistic import HolisticSettings, cut_windows, metric_windows, pixel_grid
from hlp.patches.region import RegionSettings
from hlp.records import Frame
from networks import scaled, trained

HOLISTIC = HolisticSettings(64, "rgbd")
EXACT = RegionSettings(16, 0.15, 8, 0.7, "exact")
FAST = dataclasses.replace(EXACT, scan="fast")
CAMERA = np.array([[570.0, 0.0, 319.5], [0.0, 570.0, 239.5], [0.0, 0.0, 1.0]])
STEP = 16
SIZES = {1: 0.10, 2: 0.11, 3: 0.10, 4: 0.20}


@pytest.fixture(scope="module")
def objects():
    model = next(iter(demo_objects().values()))
    return {
        i: dataclasses.replace(model, object_id=i, holistic_size=size, diameter=1.2 * size)
        for i, size in SIZES.items()
    }


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(0)
    network = trained(HolisticCNN(4, 5, (4, 8), 16, 0.1), 64)
    network.head[-1].weight.data *= 10  # so that windows differ
    return network.eval()


@pytest.fixture(scope="module")
def loaded(network, tmp_path_factory):
    """The network as detection has it."""
    stem = tmp_path_factory.mktemp("scan") / "classifier"
    gen = torch.Generator().manual_seed(1)
    sample = torch.rand((256, 4, 64, 64), generator=gen) * 2 - 1
    export_network(network, sample, stem, levels=True)
    return load_network(stem, threads=2)


@pytest.fixture(scope="module")
def frame():
    """A wall, a quarter of it covered by something uneven; depth is missing in a stripe."""
    rng = np.random.default_rng(0)
    x = np.broadcast_to(np.arange(320), (240, 320))
    depth = (0.9 + 0.0005 * x).astype(np.float32)
    depth[:120, :160] -= 0.1 + 0.05 * np.sin(x / 9.0)[:120, :160].astype(np.float32)
    depth[:, 200:230] = 0.0
    rgb = rng.integers(0, 256, (240, 320, 3)).astype(np.uint8)
    camera = np.array([[400.0, 0.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]])
    return Frame(1, 1, rgb, depth, camera)


def scan(network, objects, settings, threads=1):
    return HolisticScan(network, objects, HOLISTIC, settings, threads)


def one_by_one(network, frame, size):
    """The reference: windows as training cuts them, the network as it was trained."""
    windows = metric_windows(frame.depth, frame.camera_matrix, size, EXACT.step)
    color, code = cut_windows(frame.rgb, frame.depth, windows, size, 64)
    images = scaled(np.concatenate([color, code[..., None]], axis=-1))
    with torch.no_grad():
        return windows, torch.softmax(network(images), dim=1).numpy()


def test_the_exact_scan_is_the_network_on_every_window(loaded, network, objects, frame):
    exact = scan(loaded, objects, EXACT, threads=2)
    for object_id, size in SIZES.items():
        windows, expected = one_by_one(network, frame, size)
        found, classes = FrameWindows(exact, frame).classify(object_id)
        np.testing.assert_array_equal(found.centers, windows.centers)
        np.testing.assert_array_equal(found.sides, windows.sides)
        np.testing.assert_allclose(classes, expected, atol=0.05)  # 8-bit integers
        assert np.abs(expected - expected.mean(axis=0)).max() > 0.05  # windows do differ


@pytest.mark.parametrize("settings", [EXACT, FAST])
def test_other_objects_their_order_and_threads_change_nothing(loaded, objects, frame, settings):
    alone = scan(loaded, objects, settings)
    expected = {i: FrameWindows(alone, frame).classify(i) for i in objects}
    together = FrameWindows(scan(loaded, objects, settings, threads=2), frame)
    for object_id in (4, 2, 3, 1):
        windows, classes = together.classify(object_id)
        np.testing.assert_array_equal(classes, expected[object_id][1])
        np.testing.assert_array_equal(windows.sides, expected[object_id][0].sides)


def test_windows_are_classified_once_for_all_objects_that_share_them(loaded, objects, frame):
    exact, fast = (FrameWindows(scan(loaded, objects, item), frame) for item in (EXACT, FAST))
    assert exact.classify(2)[1] is not exact.classify(1)[1] is exact.classify(3)[1]
    assert fast.classify(4)[1] is not fast.classify(1)[1] is fast.classify(2)[1]
    for object_id in (1, 2):  # sides are the objects' own
        windows, _ = fast.classify(object_id)
        np.testing.assert_allclose(windows.sides * windows.depths, 400 * SIZES[object_id])


def test_the_fast_scan_leaves_out_the_wall_and_is_exact_elsewhere(loaded, objects, frame):
    alone = {4: objects[4]}  # a size of its own
    windows, classes = FrameWindows(scan(loaded, alone, EXACT), frame).classify(4)
    fewer, found = FrameWindows(scan(loaded, alone, FAST), frame).classify(4)
    x, y = windows.centers.T
    uneven = (x < 160) & (y < 120)
    rows = {tuple(center): i for i, center in enumerate(windows.centers)}
    kept = np.array([rows[tuple(center)] for center in fewer.centers])
    assert uneven[kept].mean() > 0.9 and len(kept) > 0.8 * uneven.sum() / 2  # every other window
    np.testing.assert_array_equal(found, classes[kept])
    np.testing.assert_array_equal(fewer.sides, windows.sides[kept])


def test_a_frame_without_depth_has_no_windows(loaded, objects, frame):
    blind = dataclasses.replace(frame, depth=np.zeros_like(frame.depth))
    for settings in (EXACT, FAST):
        windows, classes = FrameWindows(scan(loaded, objects, settings), blind).classify(1)
        assert (windows.centers.shape, classes.shape) == ((0, 2), (0, 5))


def groups_of(sizes, apart):
    return group_sizes({i: (size, size * (1 + i / 10)) for i, size in enumerate(sizes)}, apart)


def test_at_no_distance_only_equal_sizes_share_windows():
    found = groups_of([0.1, 0.2, 0.1, 0.11], 1.0)
    assert [found[i].metric_size for i in range(4)] == [0.1, 0.2, 0.1, 0.11]
    assert found[0] == found[2]
    assert found[0].diameter == pytest.approx(0.12)  # the largest of the two
    assert found[3].diameter == pytest.approx(0.143)


def test_a_shared_size_is_in_the_middle_of_those_that_share_it():
    sizes = [0.08, 0.2, 0.18, 0.15, 0.2, 0.13, 0.1, 0.2, 0.09, 0.12, 0.08, 0.11, 0.15, 0.2, 0.16]
    found = groups_of(sizes, 1.25)  # LINEMOD's 15 objects
    ratios = [found[i].metric_size / size for i, size in enumerate(sizes)]
    assert 1.05 < max(ratios) <= 1.25**0.5 + 1e-9
    assert max(ratios) * min(ratios) == pytest.approx(1.0)
    assert len(set(found.values())) == 4
    for i in range(15):
        members = [k for k in range(15) if found[k] == found[i]]
        assert found[i].diameter == max(sizes[k] * (1 + k / 10) for k in members)


def table(tilt=0.9, height=0.08, width=0.10, noise=0.002):
    """A table seen at an angle with a box on it, a camera's noise and holes; the box's mask."""
    rng = np.random.default_rng(0)
    rays = np.stack(np.meshgrid(np.arange(640), np.arange(480)), axis=-1)
    rays = np.concatenate([(rays - CAMERA[:2, 2]) / 570.0, np.ones((480, 640, 1))], axis=-1)
    normal = np.array([0.0, -np.cos(tilt), -np.sin(tilt)])  # towards the camera
    far = -0.9 * np.sin(tilt) / (rays @ normal)  # depth 0.9 m in the middle
    near = (height - 0.9 * np.sin(tilt)) / (rays @ normal)
    down = np.array([0.0, np.sin(tilt), -np.cos(tilt)])
    middle = np.array([0.0, 0.0, 0.9])
    places = near[..., None] * rays - middle
    box = (np.abs(places @ down) < width / 2) & (np.abs(places[..., 0]) < width / 2)
    depth = np.where(box, near, far) + rng.normal(0, noise, far.shape)
    depth[rng.random(depth.shape) < 0.05] = 0.0
    return depth.astype(np.float32), box


def windows_off(depth, diameter, size=0.1):
    windows = metric_windows(depth, CAMERA, size, STEP)
    planes = find_planes(windows, CAMERA, STEP)
    off = off_planes(planes, len(windows.sides), diameter)
    x, y = windows.centers.astype(int).T
    return off, (x, y)


def test_windows_on_a_table_are_left_out_and_those_on_objects_are_kept():
    """Those on the table, too, if an object could have such a plane."""
    depth, box = table()
    off, (x, y) = windows_off(depth, 0.13)
    assert box[y, x].sum() > 10
    assert off[box[y, x]].all()
    assert off[~box[y, x]].mean() < 0.02
    assert windows_off(depth, 2.0)[0].all()


def test_a_scene_without_a_plane_keeps_all_windows():
    heaps = np.random.default_rng(0).normal(0.9, 0.1, (8, 10)).astype(np.float32)
    depth = cv2.resize(heaps, (640, 480), interpolation=cv2.INTER_CUBIC)
    off, _ = windows_off(depth, 0.1)
    assert off.all()


def test_two_planes_are_found():
    depth, _ = table()
    wall = depth.copy()
    wall[:200] = 1.4
    off, (_, y) = windows_off(wall, 0.13)
    assert off[y < 192].mean() < 0.02
    assert off[y > 208].mean() < 0.05


def test_the_area_counts_as_it_is_not_as_it_is_seen():
    y, _ = np.mgrid[:480, :640]
    depth = (1.0 / (1.6 - y / 480)).astype(np.float32)  # a floor that recedes
    windows = metric_windows(depth, CAMERA, 0.1, STEP)
    corners = np.array([[-8.0, -8], [8, -8], [8, 8], [-8, 8]])
    normal, total = None, 0.0
    for center in windows.centers:
        rays = np.c_[(center + corners - CAMERA[:2, 2]) / 570.0, np.ones(4)]
        rows = (center + corners)[:, 1]
        quad = rays / (1.6 - rows / 480)[:, None]
        normal = np.cross(quad[2] - quad[0], quad[3] - quad[1])
        total += np.linalg.norm(normal) / 2
    assert project(quad, CAMERA)[0] == pytest.approx(center + corners[0])
    (plane,) = find_planes(windows, CAMERA, STEP)
    assert plane.windows.all()
    assert plane.area == pytest.approx(total, rel=0.03)
    assert not off_planes([plane], len(windows.sides), 0.97 * np.sqrt(total)).any()
    assert off_planes([plane], len(windows.sides), 1.03 * np.sqrt(total)).all()


def test_too_few_windows_for_a_plane_are_fine():
    windows = metric_windows(table()[0], CAMERA, 0.1, STEP)
    for count in (0, 2, 3):
        assert find_planes(windows.at(slice(0, count)), CAMERA, STEP) == []
    assert off_planes([], 2, 0.1).all()


def test_a_checkerboard_keeps_half_and_no_two_neighbours():
    centers = pixel_grid((480, 640), 16).astype(float)
    kept = checkerboard(centers, 16)
    assert kept.sum() == len(centers) / 2
    apart = np.linalg.norm(centers[kept][:, None] - centers[kept][None], axis=2)
    assert apart[apart > 0].min() == pytest.approx(16 * np.sqrt(2))
