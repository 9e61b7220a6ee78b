import numpy as np
import pytest
import torch
from scipy.ndimage import convolve

from hlp.patches import augmentation as aug


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def images(n=6, size=16):
    return torch.rand((n, 3, size, size), generator=generator(9))


DRAWS = {
    "surface": lambda gen: aug.vary_surface(images(), gen),
    "camera": lambda gen: aug.vary_camera(images(), gen),
    "blur": lambda gen: aug.blur(images(), gen, 0.5),
    "rectangles": lambda gen: aug.rectangles(gen, 40, 16, 0.5, 0.2, 0.6),
    "planes": lambda gen: aug.random_planes(gen, 6, 16, -0.3, 1.2),
    "noise": lambda gen: aug.smooth_noise(gen, 6, 16, 4),
}


@pytest.mark.parametrize("name", DRAWS)
def test_draws_come_from_the_generator_alone(name):
    first = DRAWS[name](generator(1))
    torch.rand(3)
    assert torch.equal(DRAWS[name](generator(1)), first)
    assert not torch.equal(DRAWS[name](generator(2)), first)


def test_uniform_and_normal_have_their_ranges():
    drawn = aug.uniform(generator(), (20_000,), -0.5, 1.5)
    assert drawn.min() >= -0.5 and drawn.max() < 1.5
    assert float(drawn.mean()) == pytest.approx(0.5, abs=0.02)
    assert float(aug.normal(generator(), (20_000,), 0.3).std()) == pytest.approx(0.3, rel=0.03)


def test_the_surface_keeps_black_black_and_a_grey_object_is_tinted_as_one():
    grey = torch.full((4, 3, 8, 8), 0.5)
    varied = aug.vary_surface(grey, generator())
    assert float(varied.flatten(2).std(dim=2).max()) < 1e-6  # one colour over the whole object
    assert float(varied.mean(dim=(2, 3)).std()) > 0.05
    assert torch.equal(aug.vary_surface(torch.zeros_like(grey), generator()), 0 * grey)


def test_the_camera_keeps_colours_between_0_and_1():
    varied = aug.vary_camera(images(200) * 3.0, generator())
    assert varied.min() >= 0 and varied.max() <= 1
    assert torch.isfinite(varied).all()


def test_blur_smooths_its_share_with_the_binomial_kernel():
    source = images(400, 8)
    blurred = aug.blur(source, generator(), 0.5)
    line = np.array([0.25, 0.5, 0.25])
    kernel = np.outer(line, line)
    counts = {"sharp": 0, "once": 0, "twice": 0}
    for image, result in zip(source.numpy(), blurred.numpy(), strict=True):
        once = np.stack([convolve(c, kernel, mode="nearest") for c in image])
        twice = np.stack([convolve(c, kernel, mode="nearest") for c in once])
        for name, expected in (("sharp", image), ("once", once), ("twice", twice)):
            counts[name] += np.allclose(result, expected, atol=1e-5)
    assert sum(counts.values()) == 400
    assert counts["sharp"] == pytest.approx(200, abs=40)
    assert counts["once"] == pytest.approx(100, abs=35)


def test_rectangles_are_rectangles_of_the_asked_size_and_share():
    n, size = 600, 40
    masks = aug.rectangles(generator(), n, size, 0.5, 0.2, 0.6).numpy()
    drawn = [mask for mask in masks if mask.any()]
    # half are drawn; of those about one in six lies off the image
    assert 0.3 * n < len(drawn) < 0.5 * n
    for mask in drawn:
        y, x = np.nonzero(mask)
        box = (slice(y.min(), y.max() + 1), slice(x.min(), x.max() + 1))
        assert mask[box].all()
        assert max(np.ptp(y), np.ptp(x)) + 1 <= 0.6 * size + 1
    assert not aug.rectangles(generator(), n, size, 0.0, 0.2, 0.6).any()


def test_planes_are_planes():
    planes = aug.random_planes(generator(), 5, 12, -0.3, 1.2)
    for second in (planes.diff(dim=1).diff(dim=1), planes.diff(dim=2).diff(dim=2)):
        assert float(second.abs().max()) < 1e-5
    middle = planes.mean(dim=(1, 2))
    assert middle.min() >= -0.3 and middle.max() <= 1.2


def test_smooth_noise_is_smooth():
    field = aug.smooth_noise(generator(), 50, 32, 4)
    steps = field.diff(dim=2).abs().mean()
    assert float(steps) < 0.3 * float(field.std())
