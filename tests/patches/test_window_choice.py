"""Which windows are classified; the likeliest places of an object and the squares around them."""

import cv2
import numpy as np
import pytest

from hlp.geometry import project
from hlp.patches.holistic import metric_windows, pixel_grid, union_of_squares
from hlp.patches.window_choice import (
    CloserLookSettings,
    checkerboard,
    find_planes,
    first_region,
    group_sizes,
    likely_places,
    likely_regions,
    off_planes,
)
from hlp.records import Region

CAMERA = np.array([[570.0, 0.0, 319.5], [0.0, 570.0, 239.5], [0.0, 0.0, 1.0]])
STEP = 16


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


def region_of(centers, probabilities):
    mask = np.zeros((60, 80), dtype=bool)
    return Region(4, np.array(centers, float).reshape(-1, 2), np.array(probabilities), mask)


def test_a_window_beside_a_likelier_one_is_no_place_of_its_own():
    rng = np.random.default_rng(2)
    centers = rng.uniform(0, 60, (200, 2))
    region = region_of(centers, rng.uniform(0, 1, 200))
    radii = rng.uniform(5, 15, 200)
    rows = likely_places(region, radii, 8, 0.02)
    assert len(rows) == 8
    expected = []  # one after another, by their definition
    for row in np.argsort(-region.probabilities):
        near = [np.linalg.norm(centers[row] - centers[k]) < radii[k] for k in expected]
        if not any(near):
            expected.append(int(row))
    assert rows.tolist() == expected[:8]


def test_improbable_windows_are_no_places():
    region = region_of([(10, 10), (50, 10), (70, 50)], [0.5, 0.01, 0.3])
    assert likely_places(region, np.full(3, 5.0), 9, 0.02).tolist() == [0, 2]
    assert likely_places(region_of([], []), np.zeros(0), 9, 0.02).tolist() == []


def test_squares_of_a_few_places_at_a_time():
    region = region_of([(10, 10), (40, 10), (70, 50)], [0.2, 0.4, 0.3])
    settings = CloserLookSettings(places=3, places_at_once=2, side=1.0)
    first, second = likely_regions(region, np.full(3, 6.0), settings, False, False)
    assert first.object_id == 4 and first.mask.shape == (60, 80)
    y, x = np.nonzero(second.mask)
    assert (x.min(), x.max(), y.min(), y.max()) == (4, 16, 4, 16)
    assert first.mask.sum() == 2 * 169 and first.mask[10, 40] and first.mask[50, 70]


def test_as_many_places_as_asked_for():
    region, radii = region_of([(10, 10), (40, 10), (70, 50)], [0.2, 0.4, 0.1]), np.full(3, 6.0)
    for most, known, all_, found in [(None, 1, 1, 0), (1, 1, 0, 1), (3, 0, 0, 2), (1, 1, 1, 3)]:
        settings = CloserLookSettings(places=most, places_at_once=1)
        assert len([*likely_regions(region, radii, settings, known, all_)]) == found


def test_of_a_large_region_the_likeliest_windows_come_first():
    rng = np.random.default_rng(5)
    centers, probabilities = rng.uniform(0, (640, 480), (400, 2)), rng.uniform(0, 1, 400)
    radii = np.full(400, 40.0)
    everything = union_of_squares(centers, radii * 0.7, (480, 640))
    region = Region(4, centers, probabilities, everything)
    found = first_region(region, radii, 0.7, CloserLookSettings(first_area=6.0))
    assert np.count_nonzero(found.mask) == pytest.approx(6.0 * 80.0**2, rel=0.15)
    three = first_region(region, radii, 0.7, CloserLookSettings(first_area=2.0), 3)
    assert np.array_equal(three.mask, found.mask)
    # One square after the other, until the area is reached.
    order = np.argsort(-probabilities)
    areas = [
        union_of_squares(centers[order[:n]], radii[order[:n]] * 0.7, (480, 640)) for n in range(99)
    ]
    assert any((found.mask == area).all() for area in areas)


def test_a_small_region_is_searched_whole():
    mask = np.zeros((60, 80), dtype=bool)
    mask[10:30, 10:30] = True
    region = Region(4, np.array([[20.0, 20.0]]), np.array([0.9]), mask)
    radii = np.array([6.0])
    assert first_region(region, radii, 0.7, CloserLookSettings(first_area=3.0)) is region
    assert first_region(region, radii, 0.7, CloserLookSettings(first_area=None)) is region
    least = first_region(region, radii, 0.7, CloserLookSettings(first_area=0.01))
    assert np.count_nonzero(least.mask) == 9 * 9  # the likeliest window's square
    nothing = region_of([], [])
    assert first_region(nothing, np.zeros(0), 0.7, CloserLookSettings()) is nothing
