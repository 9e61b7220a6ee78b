"""From matched codebook entries to votes for the object's centroid and rotation."""

import numpy as np
from jaxtyping import Float

from hlp.geometry import allocentric_to_egocentric
from hlp.records import Codebook, LocalPatches, Matches, ObjectModel, Votes

# The object upright, seen from 45° above: far from every pose where the choice would jump, since
# an upright object's axis never points away from this one by half a turn.
_IN_FRONT = np.array(
    [[1.0, 0.0, 0.0], [0.0, -np.sqrt(0.5), -np.sqrt(0.5)], [0.0, np.sqrt(0.5), -np.sqrt(0.5)]]
)


def cast_votes(
    patches: LocalPatches,
    matches: Matches,
    codebook: Codebook,
    model: ObjectModel,
    max_distance: float,
    weighted_by_distance: bool,
    patch_weights: Float[np.ndarray, "n"] | None = None,
) -> Votes:
    """One vote per accepted neighbour: t = p_cam + R·(centroid − p_obj), rotation R.

    R is the entry's rotation turned from the optical axis to the patch's viewing ray (allocentric
    to egocentric). Neighbours farther than `max_distance` (the paper's Th, in units of the
    codebook's `feature_scale`) cast none. `weighted_by_distance` gives a vote exp(−d²/2σ²), σ the feature
    scale; otherwise each counts 1. `patch_weights` in each of the n patches multiplies its votes. Of the
    rotations that a symmetric object cannot tell apart, all votes name the same one.
    """
    relative = matches.distances / codebook.feature_scale
    rows, ranks = np.nonzero(relative <= max_distance)
    entries = matches.indices[rows, ranks]
    points_cam = patches.points_cam[rows]
    turns = allocentric_to_egocentric(patches.points_cam)[rows]
    rotations = turns @ codebook.rotations_cam_obj[entries].astype(np.float64)
    to_centroid = model.centroid - codebook.points_obj[entries]
    centroids = points_cam + np.einsum("vij,vj->vi", rotations, to_centroid)
    weights = (
        np.exp(-(relative[rows, ranks] ** 2) / 2.0) if weighted_by_distance else np.ones(len(rows))
    )
    if patch_weights is not None:
        weights = weights * patch_weights[rows]
    turned = canonical_rotations(rotations, model.symmetries)
    return Votes(centroids, turned, weights.astype(np.float64), rows, patches.pixels[rows])


def canonical_rotations(
    rotations: Float[np.ndarray, "v 3 3"], symmetries: Float[np.ndarray, "s 4 4"]
) -> Float[np.ndarray, "v 3 3"]:
    """Of the rotations R·S that look alike, the one nearest to an object seen from above in front.

    Without it the votes for one pose of a bowl are spread around its axis and make no mode.
    """
    if len(symmetries) == 1:
        return rotations
    turns = symmetries[:, :3, :3]
    # tr(Aᵀ R S) is largest where R S is nearest to A; as a matrix product over all pairs.
    likeness = (np.swapaxes(rotations, 1, 2) @ _IN_FRONT).reshape(-1, 9) @ turns.reshape(-1, 9).T
    return np.asarray(rotations @ turns[np.argmax(likeness, axis=1)])
