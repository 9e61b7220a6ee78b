"""Random image effects that make renderings of local patches look like photographs (torch).

White balance, exposure, saturation, blur, noise, occluders and surroundings. All random numbers
come from the given generator.
"""

import torch
from torch import Tensor
from torch.nn import functional

_GREY = torch.tensor([0.299, 0.587, 0.114])


def uniform(gen: torch.Generator, shape: tuple[int, ...], low: float, high: float) -> Tensor:
    """Uniform random numbers in [low, high)."""
    return torch.rand(shape, generator=gen) * (high - low) + low


def normal(gen: torch.Generator, shape: tuple[int, ...], sigma: float) -> Tensor:
    """Normal random numbers with mean 0."""
    return torch.randn(shape, generator=gen).mul_(sigma)


def vary_surface(color: Tensor, gen: torch.Generator) -> Tensor:
    """Random white balance, exposure and saturation of an object's colour (n, 3, h, w), 0…1."""
    n = len(color)
    gain = torch.exp(normal(gen, (n, 3, 1), 0.2) + uniform(gen, (n, 1, 1), -0.7, 0.35))
    saturation = (1.0 + normal(gen, (n, 1, 1), 0.3)).clamp(min=0.0)
    # grey + (colour − grey)·saturation, times gain, as one matrix: one pass instead of five.
    mix = gain * (saturation * torch.eye(3) + (1.0 - saturation) * _GREY)
    return (mix @ color.flatten(2)).view(color.shape)


def vary_camera(color: Tensor, gen: torch.Generator) -> Tensor:
    """Random exposure, gamma, contrast, blur (on half) and noise of images (n, 3, h, w), 0…1."""
    n = len(color)
    color = color * torch.exp(uniform(gen, (n, 1, 1, 1), -0.7, 0.2))
    color.clamp_(0.0, 1.0).pow_(torch.exp(normal(gen, (n, 1, 1, 1), 0.2)))
    mean = color.mean(dim=(1, 2, 3), keepdim=True)
    contrast = (1.0 + normal(gen, (n, 1, 1, 1), 0.2)).clamp(min=0.3)
    color.mul_(contrast).add_(mean * (1.0 - contrast))
    color = blur(color, gen, share=0.5)
    noise = normal(gen, tuple(color.shape), 1.0)
    noise.mul_(uniform(gen, (n, 1, 1, 1), 0.0, 0.04))
    return color.add_(noise).clamp_(0.0, 1.0)


def blur(image: Tensor, gen: torch.Generator, share: float) -> Tensor:
    """Binomial 3 × 3 blur of about a `share` of the images (n, c, h, w), of half of them twice."""
    kernel = torch.tensor([0.25, 0.5, 0.25])
    square = (kernel[:, None] * kernel)[None, None].expand(image.shape[1], 1, 3, 3)

    def smooth(x: Tensor) -> Tensor:
        padded = functional.pad(x, (1, 1, 1, 1), mode="replicate")
        return functional.conv2d(padded, square, groups=image.shape[1])

    drawn = torch.rand(len(image), generator=gen)
    blurred = image.clone()
    rows = torch.nonzero(drawn < share)[:, 0]
    blurred[rows] = smooth(image[rows])
    again = torch.nonzero(drawn < share / 2)[:, 0]
    blurred[again] = smooth(blurred[again])
    return blurred


def rectangles(
    gen: torch.Generator, n: int, size: int, share: float, low: float, high: float
) -> Tensor:
    """Boolean masks (n, size, size) with a rectangle on about a `share` of them, else empty.

    Sides are `low`…`high` of the image's. Most rectangles are cut off by the border, as occluders
    are in small patches.
    """
    extent = uniform(gen, (n, 2), low, high)
    start = uniform(gen, (n, 2), -0.3, 1.0)
    axis = (torch.arange(size) + 0.5) / size
    inside = (axis > start[..., None]) & (axis < (start + extent)[..., None])
    drawn = torch.rand(n, generator=gen) < share
    return inside[:, 0, :, None] & inside[:, 1, None, :] & drawn[:, None, None]


def random_planes(gen: torch.Generator, n: int, size: int, low: float, high: float) -> Tensor:
    """Slanted planes (n, size, size): offset uniform in low…high, normal slope (σ .5 per image)."""
    axis = torch.linspace(-0.5, 0.5, size)
    offset = uniform(gen, (n, 1, 1), low, high)
    slope = normal(gen, (n, 2, 1, 1), 0.5)
    return offset + slope[:, 0] * axis[:, None] + slope[:, 1] * axis[None, :]


def smooth_noise(gen: torch.Generator, n: int, size: int, cells: int) -> Tensor:
    """Smooth random fields (n, size, size): unit normal values at `cells`² points, interpolated."""
    coarse = torch.randn((n, 1, cells, cells), generator=gen)
    return functional.interpolate(coarse, size=(size, size), mode="bilinear")[:, 0]
