"""From matched codebook entries to votes for the object's centroid and rotation."""

import numpy as np
from jaxtyping import Float

from hlp.geometry import turn_to_ray
from hlp.records import Codebook, LocalPatches, Matches, Votes


def cast_votes(
    patches: LocalPatches,
    matches: Matches,
    codebook: Codebook,
    centroid_obj: Float[np.ndarray, "3"],
    max_distance: float,
    weighted: bool,
) -> Votes:
    """One vote per accepted neighbour: t = p_cam + R·(centroid − p_obj), rotation R.

    R is the entry's rotation turned from the optical axis to the patch's viewing ray (allocentric
    to egocentric). Neighbours farther than `max_distance` (the paper's Th, in units of the
    codebook's `feature_scale`) cast none. `weighted` gives a vote exp(−d²/2σ²), σ the feature
    scale; otherwise each counts 1.
    """
    relative = matches.distances / codebook.feature_scale
    rows, ranks = np.nonzero(relative <= max_distance)
    entries = matches.indices[rows, ranks]
    points_cam = patches.points_cam[rows]
    turns = turn_to_ray(patches.points_cam)[rows]
    rotations = turns @ codebook.rotations_cam_obj[entries].astype(np.float64)
    to_centroid = centroid_obj - codebook.points_obj[entries]
    centroids = points_cam + np.einsum("vij,vj->vi", rotations, to_centroid)
    weights = np.exp(-(relative[rows, ranks] ** 2) / 2.0) if weighted else np.ones(len(rows))
    return Votes(centroids, rotations, weights.astype(np.float64), rows, patches.pixels[rows])
