"""Stage 0: where the views of an object are rendered from (paper, section 3.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int, UInt8

from hlp.records import MILLIMETRES_PER_METRE, LocalPatches, Views
from hlp.reporting.figures.saving import titled, with_legend
from hlp.reporting.figures.tiles import (
    below,
    beside,
    depth_tile,
    patch_tile,
    resized,
    sheet,
    with_depths,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.axes3d import Axes3D  # type: ignore[import-untyped]

_NEAR, _FAR = "#0072b2", "#b9d3e6"
_PLACES = {"from the side": (12.0, -60.0), "from above": (90.0, -90.0)}
_ROUND = 4  # digits by which equal directions are told


def viewpoint_figure(views: Views, name: str) -> "Figure":
    """The sphere of viewpoints in object coordinates, from the side and from above."""
    from matplotlib.figure import Figure

    points = directions(views)
    angles = nearest_angles_deg(points)
    figure = Figure(figsize=(8.4, 4.4), layout="constrained")
    for number, (title, (up, turn)) in enumerate(_PLACES.items(), 1):
        axes = figure.add_subplot(1, 2, number, projection="3d", proj_type="ortho")
        _draw(axes, points, up, turn)
        if number == 1:
            axes.legend(
                loc="upper center", bbox_to_anchor=(0.5, 0.12), ncols=2, frameon=False, fontsize=8
            )
        axes.set_title(title, fontsize=10)
    figure.suptitle(
        f"Where the views of {name} are rendered from: {len(points)} viewpoints,"
        f" {len(views) / len(points):.3g} turns of the camera at each\n"
        f"nearest viewpoints are {np.median(angles):.1f}° apart"
        f" ({angles.min():.1f}° to {angles.max():.1f}°)",
        fontsize=11,
    )
    return figure


def directions(views: Views) -> Float[np.ndarray, "n 3"]:
    """Unit vectors from the object to the viewpoints, each once, in object coordinates."""
    poses = np.asarray(views.poses_cam_obj, dtype=np.float64)
    # The object's centroid lies on the optical axis, whatever its origin.
    back = -poses[:, 2, :3]
    unit = back / np.linalg.norm(back, axis=1, keepdims=True)
    _, first = np.unique(np.round(unit, _ROUND), axis=0, return_index=True)
    return np.asarray(unit[np.sort(first)])


def nearest_angles_deg(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Angle of each direction to the nearest other one; nan if there is but one."""
    if len(points) < 2:
        return np.full(len(points), np.nan)
    cosines = points @ points.T
    np.fill_diagonal(cosines, -1.0)
    return np.asarray(np.rad2deg(np.arccos(np.clip(cosines.max(axis=1), -1.0, 1.0))))


def _draw(axes: "Axes3D", points: Float[np.ndarray, "n 3"], up: float, turn: float) -> None:
    """Points of the half that faces the reader are dark; the object's axes are arrows."""
    axes.view_init(up, turn)
    a, b = np.deg2rad([up, turn])
    eye = np.array([np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a)])
    halves = {"behind": (points @ eye < 0, _FAR), "in front": (points @ eye >= 0, _NEAR)}
    for word, (half, color) in halves.items():
        axes.scatter(*points[half].T, s=9, color=color, depthshade=False, label=word)
    turns = np.linspace(0, 2 * np.pi, 90)
    axes.plot(np.cos(turns), np.sin(turns), 0 * turns, color="#8a8f98", linewidth=0.8)
    for axis, word in zip(np.eye(3), "xyz", strict=True):
        if abs(axis @ eye) > 0.99:  # it points at the reader
            continue
        axes.quiver(0, 0, 0, *(0.45 * axis), color="black", linewidth=1.2)
        axes.text(*(0.55 * axis), word, fontsize=9)
    low = min(0.0, float(points[:, 2].min()))
    axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(low, 1))
    axes.set_box_aspect((2.0, 2.0, 1.0 - low), zoom=1.2)
    axes.set_axis_off()


_VIEWS, _SIZE = 12, 84
_BACK = 200  # grey level outside the object


def draw_view_sheet(views: Mapping[str, Views]) -> UInt8[np.ndarray, "_ _ 3"]:
    """Views of each object, by its name, spread evenly over all of them."""
    rows = []
    for name, each in views.items():
        shown = min(_VIEWS, len(each))
        chosen = [i * len(each) // shown for i in range(shown)]
        rows.append((name, [resized(_tile(each, view), _SIZE) for view in chosen]))
    counts = sorted({len(each) for each in views.values()})
    number = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    title = f"Rendered views, each under another light: some of the {number} of each object"
    return titled(sheet(rows), title)


def _tile(views: Views, view: int) -> UInt8[np.ndarray, "s s 3"]:
    seen = np.asarray(views.depth[view]) > 0
    return np.where(seen[..., None], views.rgb[view], _BACK).astype(np.uint8)


_PATCH_SIZE = 64


@dataclass(frozen=True)
class PatchEntries:
    """A patch (row 0) and its nearest entries (rows 1 …), nearest first, all with colour.

    `distances` are those of the features, `apart` (m) how far each entry's place on the object is
    from the true place of the patch.
    """

    name: str
    patches: LocalPatches
    distances: Float[np.ndarray, "k"]
    apart: Float[np.ndarray, "k"]


def draw_nearest_entries(found: Sequence[PatchEntries]) -> UInt8[np.ndarray, "_ _ 3"]:
    """A row for each patch: itself, then its nearest entries; colour and depth of each."""
    rows = []
    for each in found:
        tiles = [below(patch_tile(each.patches, 0, _PATCH_SIZE), "patch in the image")]
        for rank, distance in enumerate(each.distances):
            words = f"{distance:.2f}, {MILLIMETRES_PER_METRE * each.apart[rank]:.0f} mm off"
            tiles.append(below(patch_tile(each.patches, rank + 1, _PATCH_SIZE), words))
        rows.append((each.name, tiles))
    title = "Local patches of images, and the codebook entries with the most similar features"
    words = "below an entry: distance of features, and how far it is from the true place"
    return with_depths(titled(sheet(rows), title), words)


_REBUILT_SIZE = 64


@dataclass(frozen=True)
class ReconstructedPatches:
    """Patches of one target, and what was rebuilt of them: the encoder's channels in [-1, 1].

    The first three channels are colour or normals, the last one is relative depth.
    """

    name: str
    patches: Float[np.ndarray, "n p p 4"]
    rebuilt: Float[np.ndarray, "n p p 4"]


def draw_reconstructions(found: Sequence[ReconstructedPatches]) -> UInt8[np.ndarray, "_ _ 3"]:
    """Two rows for each target: its patches, and below them what was rebuilt, with its error."""
    rows = []
    for each in found:
        errors = np.sqrt(((each.patches - each.rebuilt) ** 2).mean(axis=(1, 2, 3)))
        rows.append((each.name, [below(_rebuilt_tile(one), "patch") for one in each.patches]))
        words = [f"rebuilt, error {error:.2f}" for error in errors]
        rebuilt = zip(each.rebuilt, words, strict=True)
        tiles = [below(_rebuilt_tile(one), word) for one, word in rebuilt]
        rows.append(("", tiles))
    title = "Local patches and what the autoencoder rebuilds from their features"
    legend = "out of range: grey and far; error: root mean square over all channels, from -1 to 1"
    return with_depths(titled(sheet(rows), title), legend, missing=False)


def _rebuilt_tile(channels: Float[np.ndarray, "p p 4"]) -> UInt8[np.ndarray, "_ _ 3"]:
    color = np.rint(127.5 * (np.clip(channels[..., :3], -1.0, 1.0) + 1.0)).astype(np.uint8)
    depth = channels[..., 3]
    shown = depth_tile(depth, np.ones(depth.shape, dtype=bool))
    return beside([resized(color, _REBUILT_SIZE), resized(shown, _REBUILT_SIZE)])


_MOST, _DARK = 8, 24  # windows of a class
_MISSING = 0.999  # of the depth channel: missing depth is 1


def draw_training_samples(
    images: Float[np.ndarray, "n c p p"], labels: Int[np.ndarray, "n"], names: Sequence[str]
) -> UInt8[np.ndarray, "_ _ 3"]:
    """Some windows of each class: colour and, with four channels, depth beside it.

    Images are in [-1, 1], as the network takes them; `names` are those of the classes.
    """
    rows = []
    for label, name in enumerate(names):
        of_class = np.flatnonzero(labels == label)
        shown = min(_MOST, len(of_class))
        chosen = of_class[[i * len(of_class) // shown for i in range(shown)]]
        rows.append((name, [_window_tile(images[i]) for i in chosen]))
    picture = titled(sheet(rows), "What the classifier is trained on: some windows of each class")
    words = "background: also windows that show an object badly centred or at a wrong size"
    picture = with_legend(picture, [(words, (_DARK,) * 3)])
    return with_depths(picture) if images.shape[1] == 4 else picture


def _window_tile(image: Float[np.ndarray, "c p p"]) -> UInt8[np.ndarray, "p _ 3"]:
    color = np.rint(127.5 * (np.clip(image[:3], -1.0, 1.0) + 1.0)).astype(np.uint8)
    shown = [color.transpose(1, 2, 0)]
    if len(image) == 4:
        shown.append(depth_tile(image[3], image[3] < _MISSING))
    return beside(shown)
