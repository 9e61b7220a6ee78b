import dataclasses

import numpy as np
import pytest
import torch

from hlp.data.synthetic.objects import demo_objects
from hlp.method.find.holistic_scan import FrameWindows, HolisticScan
from hlp.models.network import load_network
from hlp.models.network_training import HolisticCNN
from hlp.models.onnx_export import export_network
from hlp.patches.holistic import HolisticSettings, RegionSettings, cut_windows, metric_windows
from hlp.records import Frame
from networks import scaled, trained

HOLISTIC = HolisticSettings(64, "rgbd")
EXACT = RegionSettings(16, 0.15, 8, 0.7, "exact")
FAST = dataclasses.replace(EXACT, scan="fast")
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
    assert exact.classify(1)[1] is exact.classify(3)[1]
    assert exact.classify(1)[1] is not exact.classify(2)[1]
    assert fast.classify(1)[1] is fast.classify(2)[1]
    assert fast.classify(1)[1] is not fast.classify(4)[1]
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
    assert uneven[kept].mean() > 0.9
    assert len(kept) > 0.8 * uneven.sum() / 2  # of every other window
    np.testing.assert_array_equal(found, classes[kept])
    np.testing.assert_array_equal(fewer.sides, windows.sides[kept])


def test_a_frame_without_depth_has_no_windows(loaded, objects, frame):
    blind = dataclasses.replace(frame, depth=np.zeros_like(frame.depth))
    for settings in (EXACT, FAST):
        windows, classes = FrameWindows(scan(loaded, objects, settings), blind).classify(1)
        assert windows.centers.shape == (0, 2)
        assert classes.shape == (0, 5)
