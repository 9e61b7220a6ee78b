"""From matched codebook entries to votes for the object's centroid and rotation."""

import numpy as np
from jaxtyping import Float

from hlp.arrays import Values
from hlp.geometry import allocentric_to_egocentric
from hlp.records import Codebook, LocalPatches, Matches, ObjectModel, Votes

# An upright object seen from 45° above: for objects that stand upright, no small change of the pose
# changes which of the equivalent rotations is nearest to this one.
_REFERENCE_ROTATION = np.array(
    [[1.0, 0.0, 0.0], [0.0, -np.sqrt(0.5), -np.sqrt(0.5)], [0.0, np.sqrt(0.5), -np.sqrt(0.5)]]
)


def cast_votes(
    patches: LocalPatches,
    matches: Matches,
    codebook: Codebook,
    model: ObjectModel,
    max_distance: float,
    weighted_by_distance: bool,
    patch_weights: Values | None = None,
) -> Votes:
    """One vote per accepted neighbour: rotation R, centroid p_cam + R·(centroid − p_obj).

    R is the rotation of the codebook entry, converted from allocentric to egocentric for the
    patch's viewing ray (paper, section 3.2). Neighbours farther than `max_distance` (the paper's
    Th, in units of the codebook's `feature_scale`) cast no vote. With `weighted_by_distance` a vote
    weighs exp(−d²/2), d in the same units, otherwise 1; `patch_weights` multiplies the votes of
    each of the n patches. Of the equivalent rotations of a symmetric object all votes take the same
    one, see `canonical_rotations`.
    """
    relative = matches.distances / codebook.feature_scale
    rows, ranks = np.nonzero(relative <= max_distance)
    entries = matches.indices[rows, ranks]
    points_cam = patches.points_cam[rows]
    to_egocentric = allocentric_to_egocentric(patches.points_cam)[rows]
    rotations = to_egocentric @ codebook.rotations_cam_obj[entries].astype(np.float64)
    to_centroid = model.centroid - codebook.points_obj[entries]
    centroids = points_cam + np.einsum("vij,vj->vi", rotations, to_centroid)
    weights = (
        np.exp(-(relative[rows, ranks] ** 2) / 2.0) if weighted_by_distance else np.ones(len(rows))
    )
    if patch_weights is not None:
        weights = weights * patch_weights[rows]
    canonical = canonical_rotations(rotations, model.symmetries)
    return Votes(centroids, canonical, weights.astype(np.float64), rows, patches.pixels[rows])


def canonical_rotations(
    rotations: Float[np.ndarray, "v 3 3"], symmetries: Float[np.ndarray, "s 4 4"]
) -> Float[np.ndarray, "v 3 3"]:
    """Of each rotation's equivalents R·S under the symmetries S, the nearest to a fixed reference.

    Without this, the votes for one pose of a bowl would spread around its axis and form no mode.
    """
    if len(symmetries) == 1:
        return rotations
    equivalent = symmetries[:, :3, :3]
    # tr(Aᵀ R S) is largest where R S is nearest to A. One matrix product gives all traces.
    relative = np.swapaxes(rotations, 1, 2) @ _REFERENCE_ROTATION
    traces = relative.reshape(-1, 9) @ equivalent.reshape(-1, 9).T
    return np.asarray(rotations @ equivalent[np.argmax(traces, axis=1)])
