"""Batches for the local encoders, with random effects that make renderings look like photographs.

White balance, exposure, saturation, blur, noise, occluders and surroundings. All random numbers
come from a given generator.
"""

import torch
from torch import Tensor
from torch.nn import functional

from hlp.arrays import Rows
from hlp.patches.local_pool import PairPool
from hlp.patches.pool_loader import Batch, PoolDataModule
from hlp.records import LocalPatches

_FILL = 128.0 / 255.0
# Like a Kinect at about one metre: noise and quantisation of depth (m).
_DEPTH_NOISE = 0.0025
_DEPTH_STEP = 0.003
_GREY = torch.tensor([0.299, 0.587, 0.114])


class PairDataModule(PoolDataModule):
    """Pairs for contrastive training: a patch as a camera would see it, and a clean one.

    A batch is a dictionary. `noisy` and `clean` are triples of color (n, 3, p, p) in 0…1, depth and
    valid (n, p, p). `object_ids`, `points_obj` and `rotations` serve to exclude near neighbours
    from the negatives. Colour is None unless `with_color`: it takes most of the time, and not every
    encoder uses it.
    """

    def __init__(self, pool: PairPool, with_color: bool, batch_size: int, seed: int) -> None:
        super().__init__(vars(pool), batch_size, seed)
        self.with_color = with_color

    def on_before_batch_transfer(self, batch: Batch, dataloader_idx: int) -> dict[str, object]:
        """Degrade the first patch of each pair on the CPU, seeded by the batch's number."""
        gen = torch.Generator().manual_seed(self.seed * 1_000_003 + self.batch_number)
        depth, valid = batch["depth"].float(), batch["valid"]
        seen_depth, seen, clutter = degrade_depth(depth[:, 0], valid[:, 0], batch["sizes"], gen)
        noisy_color, clean_color = None, None
        if self.with_color:
            color = batch["color"].permute(0, 1, 4, 2, 3).float() / 255.0
            noisy_color = degrade_color(color[:, 0], seen, clutter, gen)
            clean_color = color[:, 1]
        return {
            "noisy": (noisy_color, seen_depth, seen),
            "clean": (clean_color, depth[:, 1], valid[:, 1]),
            **{name: batch[name] for name in ("object_ids", "points_obj", "rotations")},
        }


class PatchDataModule(PoolDataModule):
    """Local patches for the autoencoder: `color`, `depth`, `valid`, as they were cut.

    With `varied_light` a batch also holds `seen`: the colour (n, 3, p, p) in 0…1 as a camera would
    see it under another light.
    """

    def __init__(
        self, patches: LocalPatches, batch_size: int, seed: int, varied_light: bool = False
    ) -> None:
        arrays = {"color": patches.color, "depth": patches.depth, "valid": patches.valid}
        super().__init__(arrays, batch_size, seed)
        self.varied_light = varied_light

    def on_before_batch_transfer(self, batch: Batch, dataloader_idx: int) -> Batch:
        """Vary the light on the CPU, seeded by the batch's number."""
        if not self.varied_light:
            return batch
        gen = torch.Generator().manual_seed(self.seed * 1_000_003 + self.batch_number)
        color = batch["color"].permute(0, 3, 1, 2).float() / 255.0
        return {**batch, "seen": vary_camera(vary_surface(color, gen), gen)}


def degrade_depth(
    depth: Tensor, valid: Tensor, size: Tensor, gen: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Depth (n, p, p) of clean patches as a camera in clutter would measure it.

    Surroundings such as a table appear inside the metric cube, occluders cover a part, depth is
    noisy and quantised and has holes, and the centre's depth, to which all is relative, has an
    error. `size` (n,) is in m. Returns depth, valid, and where clutter was added.
    """
    n, p = len(depth), depth.shape[-1]
    half = size[:, None, None] / 2
    depth, clutter = _add_clutter(depth, valid, gen)
    noise = normal(gen, (n, p, p), 1.0) + smooth_noise(gen, n, p, 8)
    level = uniform(gen, (n, 1, 1), 0.2, 1.0) * _DEPTH_NOISE / half
    depth = depth + noise * level + normal(gen, (n, 1, 1), 0.5) * level
    step = uniform(gen, (n, 1, 1), 0.2, 1.0) * _DEPTH_STEP / half
    depth = torch.round(depth / step) * step
    occluder = _rectangles(gen, n, p)
    middle = slice(p // 2 - 2, p // 2 + 2)
    occluder &= ~occluder[:, middle, middle].any(dim=(1, 2))[:, None, None]
    holes = smooth_noise(gen, n, p, 8) > uniform(gen, (n, 1, 1), 1.2, 4.0)
    valid = (valid | clutter) & ~occluder & ~holes & (depth.abs() <= 1.0)
    return torch.where(valid, depth, torch.ones(())), valid, clutter


def degrade_color(color: Tensor, valid: Tensor, clutter: Tensor, gen: torch.Generator) -> Tensor:
    """Colour (n, 3, p, p) in 0…1 of clean patches under another light, as a camera sees it.

    `valid` and `clutter` (n, p, p) are results of `degrade_depth`.
    """
    n, size = len(color), color.shape[-2:]
    tint = uniform(gen, (n, 3, 1, 1), 0.0, 1.0)
    texture = torch.randn((n, 3, 4, 4), generator=gen) * uniform(gen, (n, 1, 1, 1), 0.0, 0.3)
    paint = tint + functional.interpolate(texture, size=size, mode="bilinear")
    color = torch.where(clutter[:, None], paint, vary_surface(color, gen))
    return torch.where(valid[:, None], vary_camera(color, gen), torch.tensor(_FILL))


def _add_clutter(depth: Tensor, valid: Tensor, gen: torch.Generator) -> tuple[Tensor, Tensor]:
    """Fill invalid pixels with slanted planes, like a table or a neighbour; depth and where."""
    n, p = len(depth), depth.shape[-1]
    axis = torch.linspace(-0.5, 0.5, p)
    plane = uniform(gen, (n, 1, 1), -0.3, 1.2)
    slope = normal(gen, (n, 2, 1, 1), 0.5)
    plane = plane + slope[:, 0] * axis[:, None] + slope[:, 1] * axis[None, :]
    plane = plane + smooth_noise(gen, n, p, 4) * uniform(gen, (n, 1, 1), 0.0, 0.2)
    drawn = torch.rand((n, 1, 1), generator=gen) < 0.7
    shown = ~valid & drawn & (plane.abs() <= 1.0)
    return torch.where(shown, plane, depth), shown


def degrade_patches(patches: LocalPatches, rows: Rows, size: float, seed: int) -> LocalPatches:
    """The patches of some rows, of metric `size` (m), as a camera in clutter would see them.

    Patches without colour channels stay without.
    """
    chosen = patches[rows]
    gen = torch.Generator().manual_seed(seed)
    sizes = torch.full((len(chosen),), size)
    given = torch.from_numpy(chosen.depth), torch.from_numpy(chosen.valid)
    depth, valid, clutter = degrade_depth(*given, sizes, gen)
    rgb = chosen.color
    if rgb.shape[-1]:
        clean = torch.from_numpy(rgb).permute(0, 3, 1, 2).float() / 255.0
        color = degrade_color(clean, valid, clutter, gen)
        rgb = (color.permute(0, 2, 3, 1) * 255.0).round().to(torch.uint8).numpy()
    return LocalPatches(rgb, depth.numpy(), valid.numpy(), chosen.points_cam, chosen.pixels)


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
    color = blur(color, gen)
    noise = normal(gen, tuple(color.shape), 1.0)
    noise.mul_(uniform(gen, (n, 1, 1, 1), 0.0, 0.04))
    return color.add_(noise).clamp_(0.0, 1.0)


def blur(image: Tensor, gen: torch.Generator) -> Tensor:
    """Binomial 3 × 3 blur of about half of the images (n, c, h, w), of half of them twice."""
    kernel = torch.tensor([0.25, 0.5, 0.25])
    square = (kernel[:, None] * kernel)[None, None].expand(image.shape[1], 1, 3, 3)

    def smooth(x: Tensor) -> Tensor:
        padded = functional.pad(x, (1, 1, 1, 1), mode="replicate")
        return functional.conv2d(padded, square, groups=image.shape[1])

    drawn = torch.rand(len(image), generator=gen)
    blurred = image.clone()
    rows = torch.nonzero(drawn < 0.5)[:, 0]
    blurred[rows] = smooth(image[rows])
    again = torch.nonzero(drawn < 0.25)[:, 0]
    blurred[again] = smooth(blurred[again])
    return blurred


def _rectangles(gen: torch.Generator, n: int, size: int) -> Tensor:
    """Boolean masks (n, size, size) with a rectangle on about four of ten, else empty.

    Most rectangles are cut off by the border, as occluders are in small patches.
    """
    extent = uniform(gen, (n, 2), 0.2, 0.8)
    start = uniform(gen, (n, 2), -0.3, 1.0)
    axis = (torch.arange(size) + 0.5) / size
    inside = (axis > start[..., None]) & (axis < (start + extent)[..., None])
    drawn = torch.rand(n, generator=gen) < 0.4
    return inside[:, 0, :, None] & inside[:, 1, None, :] & drawn[:, None, None]


def smooth_noise(gen: torch.Generator, n: int, size: int, cells: int) -> Tensor:
    """Smooth random fields (n, size, size): unit normal values at `cells`² points, interpolated."""
    coarse = torch.randn((n, 1, cells, cells), generator=gen)
    return functional.interpolate(coarse, size=(size, size), mode="bilinear")[:, 0]
