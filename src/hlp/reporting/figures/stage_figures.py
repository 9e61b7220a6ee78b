"""What the stages work with: viewpoints, views, training windows, patches, the swarm's costs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from hlp.arrays import Rgb, spread
from hlp.records import MILLIMETRES_PER_METRE, LocalPatches, Views
from hlp.reporting.figures import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOTHING = 128
"""Grey level of depth that is missing, or beyond the range of a patch."""
_DARK, _BACK, _GAP = 24, 200, 3  # grey level between tiles, outside an object; px between tiles
_TILE = 0.75  # inches
_VIEWS, _WINDOWS = 12, 8  # of an object, of a class
_MISSING = 0.999  # of a window's depth channel: missing depth is 1
_DIGITS = 4  # to which directions are rounded, to find equal ones


def viewpoint_figure(views: Views, name: str) -> "Figure":
    """The sphere of viewpoints in object coordinates, from the side and from above (paper, 3.1)."""
    points = directions(views)
    figure = new_figure(8.4, 4.4)
    for number, (up, turn) in enumerate([(12.0, -60.0), (90.0, -90.0)], 1):
        axes = figure.add_subplot(1, 2, number, projection="3d", proj_type="ortho")
        axes.view_init(up, turn)
        axes.scatter(*points.T, s=9)  # those behind are paler
        axes.set(
            xlabel="x", ylabel="y", xticks=[-1, 0, 1], yticks=[-1, 0, 1], zticks=[], aspect="equal"
        )
    figure.suptitle(
        f"Where the views of {name} are rendered from: {len(points)} viewpoints,"
        f" {len(views) / len(points):.3g} turns of the camera at each"
    )
    return figure


def directions(views: Views) -> Float[np.ndarray, "n 3"]:
    """Unit vectors from the object to the viewpoints, each once, in object coordinates."""
    poses = np.asarray(views.poses_cam_obj, dtype=np.float64)
    # The object's centroid lies on the optical axis, whatever its origin.
    back = -poses[:, 2, :3]
    unit = back / np.linalg.norm(back, axis=1, keepdims=True)
    return np.unique(np.round(unit, _DIGITS), axis=0)


def view_sheet(views: Mapping[str, Views]) -> "Figure":
    """Views of each object, by its name, spread evenly over all of them."""
    rows = {}
    for name, rendered in views.items():
        chosen = [*spread(range(len(rendered)), _VIEWS)]
        seen = rendered.depth[chosen] > 0
        rows[name] = [*np.where(seen[..., None], np.asarray(rendered.rgb)[chosen], _BACK)]
    return _sheet([*rows], [*rows.values()], "Some of the views, each under another light")


def training_sheet(
    images: Float[np.ndarray, "n c p p"], labels: Int[np.ndarray, "n"], names: Sequence[str]
) -> "Figure":
    """Some windows of each class: colour and, with four channels, depth beside it.

    Images are in [-1, 1], as the network takes them; `names` are those of the classes.
    """
    rows = []
    for label in range(len(names)):
        tiles = []
        for image in spread(images[labels == label], _WINDOWS):
            color = np.rint(127.5 * (np.clip(image[:3], -1.0, 1.0) + 1.0)).astype(np.uint8)
            shown = [color.transpose(1, 2, 0)]
            if len(image) == 4:
                shown.append(depth_tile(image[3], image[3] < _MISSING))
            tiles.append(np.hstack(shown))
        rows.append(tiles)
    title = "What the classifier is trained on: some windows of each class"
    note = "background: also windows that show an object badly centred or at a wrong size"
    return _sheet(names, rows, title, note, depths=images.shape[1] == 4)


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


def entries_sheet(found: Sequence[PatchEntries]) -> "Figure":
    """A row for each patch: itself, then its nearest entries; colour and depth of each."""
    rows, words = [], []
    for near in found:
        parts = zip(near.patches.color, near.patches.depth, near.patches.valid, strict=True)
        rows.append([np.hstack([color, depth_tile(*measured)]) for color, *measured in parts])
        entries = zip(near.distances, MILLIMETRES_PER_METRE * near.apart, strict=True)
        words.append(["", *(f"{distance:.2f}, {apart:.0f} mm off" for distance, apart in entries)])
    names = [f"{near.name}:\npatch in the image" for near in found]
    title = "Local patches of images, and the codebook entries with the most similar features"
    note = "on an entry: distance of features, and how far it is from the true place"
    return _sheet(names, rows, title, note, words, depths=True)


def depth_tile(depth: Float[np.ndarray, "p p"], valid: Bool[np.ndarray, "p p"]) -> Rgb:
    """Relative depth from -1 (near, yellow) to 1 (far, violet); grey where it is not valid."""
    # These colours are without any grey.
    levels = np.rint(127.5 * (1.0 - np.clip(depth, -1.0, 1.0))).astype(np.uint8)
    colors = cv2.cvtColor(cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)
    return np.where(valid[..., None], colors, NOTHING).astype(np.uint8)


def _sheet(
    names: Sequence[str],
    rows: Sequence[Sequence[Rgb]],
    title: str,
    note: str = "",
    words: Sequence[Sequence[str]] = (),
    *,
    depths: bool = False,
) -> "Figure":
    """Rows of tiles of one size behind their names, with `words` on them; a scale of `depths`."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    edges = ((0, _GAP), (0, _GAP), (0, 0))
    framed = [[np.pad(t, edges, constant_values=_DARK) for t in tiles] for tiles in rows]
    height, width, _ = next(tile.shape for tiles in framed for tile in tiles)
    most, empty = max(map(len, framed)), np.full((height, width, 3), _DARK, dtype=np.uint8)
    picture = np.vstack([np.hstack([*t, *[empty] * (most - len(t))]) for t in framed])
    figure = new_figure(_TILE * most * width / height + 2.5, _TILE * len(rows) + 1.0)
    ax = figure.subplots()
    ax.imshow(picture)
    ax.set_yticks((np.arange(len(rows)) + 0.5) * height, names, fontsize=8)
    ax.set_xticks([])
    ax.set_xlabel(note, fontsize=8)
    for row, said in enumerate(words):
        for column, text in enumerate(said):
            ax.text(column * width + 1, row * height + 1, text, fontsize=6, va="top",
                    bbox={"facecolor": "white", "pad": 1.0, "linewidth": 0.0})  # fmt: skip
    if depths:
        scale = ScalarMappable(Normalize(-1.0, 1.0), "viridis_r")
        figure.colorbar(scale, ax=ax, ticks=[]).set_label("near   depth (grey: none)   far")
    figure.suptitle(title, fontsize=10)
    return figure


_CHOSEN, _PARTICLES, _OTHER, _TRUE, _ANSWER = "#0072b2", "#56b4e9", "#8a8f98", "#d55e00", "black"
_COLUMNS = 3


@dataclass(frozen=True)
class SwarmsOfTarget:
    """The swarms of a target, one for each hypothesis, and the costs of its true pose and answer.

    A swarm is the costs of its particles in each round, the first one before any iteration. From
    the `chosen` one the answer was refined; without an answer, `answer_cost` is None.
    """

    title: str
    swarms: Sequence[Float[np.ndarray, "rounds particles"]]
    chosen: int | None
    true_cost: float
    answer_cost: float | None


def swarm_figure(targets: Sequence[SwarmsOfTarget]) -> "Figure":
    """A panel for each target: best cost of each swarm, and all particles of the chosen one."""
    columns = min(_COLUMNS, len(targets))
    rows = -(-len(targets) // columns)
    figure = new_figure(max(3.9 * columns, 6.6), 2.9 * rows + 1.2)
    axes = [figure.add_subplot(rows, columns, number + 1) for number in range(len(targets))]
    for ax, target in zip(axes, targets, strict=True):
        _draw_swarms(ax, target)
    legends = [ax.get_legend_handles_labels() for ax in axes]
    named = {name: drawn for legend in legends for drawn, name in zip(*legend, strict=True)}
    figure.legend(
        named.values(), named, loc="outside lower center", ncols=3, frameon=False, fontsize=8
    )
    figure.suptitle("Particle swarm: costs of the poses that it tries")
    return figure


def _draw_swarms(ax: "Axes", target: SwarmsOfTarget) -> None:
    chosen = None if target.chosen is None else target.swarms[target.chosen]
    for costs in target.swarms:
        if costs is not chosen:
            ax.plot(_best(costs), color=_OTHER, linewidth=1.1, label="best of another swarm")
    if chosen is not None:
        x = np.repeat(np.arange(len(chosen)), chosen.shape[1])
        words = "each particle of the chosen swarm"
        ax.scatter(x, chosen.ravel(), s=3, color=_PARTICLES, alpha=0.5, label=words)
        ax.plot(_best(chosen), color=_CHOSEN, linewidth=2.2, label="best of the chosen swarm")
    ax.axhline(target.true_cost, color=_TRUE, linewidth=1.5, ls="--", label="true pose")
    if target.answer_cost is not None:
        last = max(map(len, target.swarms if chosen is None else [chosen])) - 1
        ax.plot(last, target.answer_cost, "*", color=_ANSWER, markersize=9, label="answer")
    ax.set_title(target.title, fontsize=9)
    ax.set(xlabel="iteration", ylabel="cost (0: fits exactly)")
    ax.margins(y=0.12)
    ax.set_ylim(bottom=0.0)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(axis="y", alpha=0.3)


def _best(costs: Float[np.ndarray, "rounds particles"]) -> Float[np.ndarray, "rounds"]:
    """The lowest cost so far."""
    return np.asarray(np.minimum.accumulate(costs.min(axis=1)))
