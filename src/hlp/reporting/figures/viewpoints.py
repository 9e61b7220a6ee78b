"""Stage 0: where the views of an object are rendered from (paper, section 3.1)."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from hlp.records import Views

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
