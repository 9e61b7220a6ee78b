"""Templates of an object: where its rendered views have edges, and in which direction.

As in LINEMOD (Hinterstoisser et al., PAMI 2012), but without a scale: features are metric, since
the depth image says how large the object appears at each place.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from annotated_types import Ge, Le, Unit
from jaxtyping import Float, Float32, Int8, UInt8

from hlp.arrays import CameraMatrix, Image, Mask, Points, Rotation, Values
from hlp.geometry import rigid
from hlp.image_edges import NO_EDGE, STEPS, edges
from hlp.records import ObjectModel
from hlp.rendering.rasterizer import render_depth
from hlp.rendering.surface import surface_and_normals
from hlp.rendering.views import thomson, turns_in_plane, view_rotations
from hlp.settings import Count, Doc, NotNegative, Settings, Share, WholeNumber

DIRECTIONS = 8
"""Directions of features, of half a turn."""
SURFACE = 16
"""Points of the surface whose depths are compared."""
_FOCAL, _OBJECT, _BORDER = 2000.0, 150, 12  # px: of the camera, the diameter, around it
_OUTLINE_SHARE = 0.6  # of the features; inner edges may have no contrast
_LEAST = 0.03  # gradient of a rendered view: the silhouette's is 1, that of normals up to 0.5
_NORMALS = 0.25  # weight of normals beside the silhouette
_MARGIN = 2.0  # of the views' spacing, about
_KEPT_SIDE = np.array([0.36, 0.48, 0.8])  # in no plane that symmetries often have
_ANCHORS = 3  # of a view: any of them may be hidden (D)
_INNER = np.ones((7, 7), np.uint8)  # px around an anchor that must be on the object


@dataclass(frozen=True)
class TemplateSettings(Settings):
    """Coarse poses by templates of gradient directions (D; not in the paper)."""

    views: Annotated[Count, Le(2562), Doc("viewpoints over the whole sphere (D)")] = 42
    turns: Annotated[Count, Le(360), Doc("turns about the optical axis, of 360° (D)")] = 24
    features: Annotated[int, Ge(16), Le(512), Doc("edge points of a template (D)")] = 48
    step: Annotated[Count, Le(64), Unit("px"), Doc("between places in the image (D)")] = 8
    reach: Annotated[
        WholeNumber, Le(32), Unit("px"), Doc("distance at which an edge still counts (D)")
    ] = 4
    least_match: Annotated[Share, Doc("share of features that a template must find (D)")] = 0.45
    compared: Annotated[
        Count, Le(10_000), Doc("best matches of which the cost is computed (D)")
    ] = 400
    kept: Annotated[Count, Le(10_000), Doc("coarse poses that are handed to the refiner (D)")] = 32
    kept_further: Annotated[
        WholeNumber, Le(10_000), Doc("more of them for each further instance (D)")
    ] = 8
    kept_here: Annotated[Count, Le(10_000), Doc("coarse poses that are kept of each place (D)")] = 8
    match_weight: Annotated[
        NotNegative, Doc("weight of the share of features found against the cost (D)")
    ] = 0.4


class Templates(NamedTuple):
    """Views of one object by their edges.

    A template is laid on the image by its anchor, a point of the surface that the view shows; each
    view has several, because one may be hidden. `rotations_cam_obj` are those of the views, in
    which the object lies on the optical axis; `anchors_cam` (m) is the anchor minus the object's
    centroid there, `normals_cam` the unit normal at the anchor, away from the camera, or 0 where
    the object is thin. `offsets` (m at the centroid's distance) are the features' places in the
    image minus the anchor's, `directions` those of the gradients in eighths of half a turn.
    `surface` are further points that the view shows: such offsets, and depths minus the anchor's
    (m).
    """

    rotations_cam_obj: Float[np.ndarray, "t 3 3"]
    anchors_cam: Float[np.ndarray, "t 3"]
    normals_cam: Float32[np.ndarray, "t 3"]
    offsets: Float32[np.ndarray, "t f 2"]
    directions: UInt8[np.ndarray, "t f"]
    surface: Float32[np.ndarray, "t 3 s"]


def build_templates(model: ObjectModel, settings: TemplateSettings) -> Templates:
    """Render the views and choose their features; views that show too little are left out."""
    distance = _FOCAL * model.diameter / _OBJECT
    side = _OBJECT + 2 * _BORDER
    centre = (side - 1) / 2.0
    camera = np.array([[_FOCAL, 0.0, centre], [0.0, _FOCAL, centre], [0.0, 0.0, 1.0]])
    views = view_rotations(_viewpoints(model, settings.views), np.zeros(1))
    poses = rigid(views, np.array([0.0, 0.0, distance]) - views @ model.centroid)
    angles = 2.0 * np.pi * np.arange(settings.turns) / settings.turns
    nothing = Templates(
        np.zeros((0, 3, 3)),
        np.zeros((0, 3)),
        np.zeros((0, 3), dtype=np.float32),
        np.zeros((0, settings.features, 2), dtype=np.float32),
        np.zeros((0, settings.features), dtype=np.uint8),
        np.zeros((0, 3, SURFACE), dtype=np.float32),
    )
    depths = render_depth(model.proxy, poses, camera, (side, side))
    found = [
        made
        for view, depth in zip(views, depths, strict=True)
        for made in _turned_view(view, depth, camera, distance, angles, settings.features)
    ]
    return Templates(*(np.concatenate(parts) for parts in zip(nothing, *found, strict=True)))


def _viewpoints(model: ObjectModel, count: int) -> Points:
    """Of so many directions over the sphere those that the object's symmetries tell apart.

    Of equivalent ones the nearest to one direction is kept, and what is hardly farther: for a
    carton, the farthest direction from any view is then 23° off instead of 20°.
    """
    stored = Path(__file__).with_name(f"directions_{count}.npy")  # SciPy need not be installed
    around = np.load(stored, allow_pickle=False) if stored.is_file() else thomson(count, 0)
    closeness = np.einsum("sij,vj,i->vs", model.symmetries[:, :3, :3], around, _KEPT_SIDE)
    return np.asarray(around[closeness[:, 0] >= closeness.max(axis=1) - _MARGIN / np.sqrt(count)])


def _turned_view(
    view: Rotation,
    depth: Image,
    camera: CameraMatrix,
    distance: float,
    angles: Values,
    features: int,
) -> Iterator[Templates]:
    """The templates of one view by each anchor, one for each angle in the view's plane.

    There are none if it shows too little.
    """
    direction, normals = _view_edges(depth, camera)
    points = _features(direction != NO_EDGE, depth > 0.0, features)
    if len(points) < features:
        return
    shown = _spread(np.argwhere(_inside(depth > 0.0))[:, ::-1], SURFACE)
    turns, of_points = turns_in_plane(angles), direction[points[:, 1], points[:, 0]]
    turned = (of_points * (np.pi / STEPS) + angles[:, None]) * (DIRECTIONS / np.pi)
    for anchor in _anchors(depth):
        at_anchor = float(depth[anchor[1], anchor[0]])
        from_centroid = np.array([*(anchor - camera[0, 2]) / _FOCAL, 1.0]) * at_anchor
        from_centroid -= [0.0, 0.0, distance]
        offsets = (points - anchor) * (distance / _FOCAL)
        surface = np.zeros((3, SURFACE))
        surface[:2, : len(shown)] = (shown - anchor).T * (distance / _FOCAL)
        surface[2, : len(shown)] = depth[shown[:, 1], shown[:, 0]] - at_anchor
        yield Templates(
            turns @ view,
            turns @ from_centroid,
            (turns @ normals[anchor[1], anchor[0]]).astype(np.float32),
            np.einsum("tij,fj->tfi", turns[:, :2, :2], offsets).astype(np.float32),
            (np.floor(turned + 0.5).astype(int) % DIRECTIONS).astype(np.uint8),
            (turns @ surface).astype(np.float32),
        )


def _view_edges(
    depth: Image, camera: CameraMatrix
) -> tuple[Int8[np.ndarray, "h w"], Float[np.ndarray, "h w 3"]]:
    """Edges of the silhouette, and where the surface turns or has a step; and its normals."""
    drawn = depth > 0.0
    inner = cv2.erode(drawn.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
    normals = np.zeros((*depth.shape, 3))
    _, normals[inner] = surface_and_normals(depth, inner, int(np.count_nonzero(inner)), camera)
    image = np.concatenate([_NORMALS * normals, drawn[..., None]], axis=-1)
    return edges(np.ascontiguousarray(image, dtype=np.float32), _LEAST), normals


def _features(among: Mask, drawn: Mask, count: int) -> np.ndarray:
    """Edge points (x, y) spread over outline and inner edges; fewer where there are not as many."""
    inside = _inside(drawn)
    outline = np.argwhere(among & ~inside)[:, ::-1]
    inner = np.argwhere(among & inside)[:, ::-1]
    most_inner = count - round(_OUTLINE_SHARE * count)
    chosen_inner = _spread(inner, most_inner)
    chosen = _spread(outline, count - len(chosen_inner))
    return np.concatenate([chosen, chosen_inner])


def _inside(drawn: Mask) -> Mask:
    return np.asarray(cv2.erode(drawn.view(np.uint8), np.ones((5, 5), np.uint8)) > 0)


def _spread(points: np.ndarray, count: int) -> np.ndarray:
    """Points that lie far from each other: each is the farthest from those before it."""
    if len(points) <= count:
        return points
    chosen = [0]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < count:
        nearest = np.minimum(nearest, np.square(points - points[chosen[-1]]).sum(axis=1))
        chosen.append(int(np.argmax(nearest)))
    return np.asarray(points[chosen])


def _anchors(depth: Image) -> np.ndarray:
    """The pixel (x, y) nearest the middle around which all is object, and others far from it."""
    drawn = (depth > 0.0).view(np.uint8)
    inner = cv2.erode(drawn, _INNER)
    places = np.argwhere(inner if inner.any() else drawn)[:, ::-1]
    middle = (np.array(depth.shape[::-1]) - 1) / 2.0
    first = np.square(places - middle).sum(axis=1).argmin()
    places[[0, first]] = places[[first, 0]]
    return _spread(places, _ANCHORS)
