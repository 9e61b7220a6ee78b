"""Results of the three detection stages in a frame: records to arrays for a file, and back."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hlp.geometry import quaternions, rotation_matrices
from hlp.method.find.estimator import CoarseResult
from hlp.records import Frame, Hypotheses, Region, Votes
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.pose_fit import PoseFit
from hlp.stages.frame_files import read_arrays

Arrays = dict[str, np.ndarray]
_FAILED = "failed"


def failure_arrays(reason: str) -> Arrays:
    """What stands in place of the results of a frame that could not be used."""
    return {_FAILED: np.array(reason)}


def failure_of(stored: Arrays) -> str | None:
    """Why a frame could not be used; None if the arrays are its results."""
    return str(stored[_FAILED]) if _FAILED in stored else None


def region_arrays(region: Region) -> Arrays:
    """A region, its mask packed into bits. Names of arrays begin with the object's id."""
    name = str(region.object_id)
    return {
        f"{name}/centers": region.centers.astype(np.float32),
        f"{name}/probabilities": region.probabilities.astype(np.float32),
        f"{name}/mask": np.packbits(region.mask),
    }


def coarse_arrays(object_id: int, coarse: CoarseResult) -> Arrays:
    """Hypotheses and votes. Votes are in single precision, which is exact to a micrometre."""
    name, votes = str(object_id), coarse.votes
    return {
        f"{name}/poses": coarse.hypotheses.poses_cam_obj,
        f"{name}/support": coarse.hypotheses.support,
        f"{name}/vote_centroids": votes.centroids_cam.astype(np.float32),
        f"{name}/vote_quaternions": quaternions(votes.rotations_cam_obj).astype(np.float32),
        f"{name}/vote_weights": votes.weights.astype(np.float32),
        f"{name}/vote_pixels": np.rint(votes.pixels).astype(np.int16),
    }


def refined_arrays(
    object_id: int, refined: RefinedHypotheses | None, fits: Sequence[PoseFit]
) -> Arrays:
    """Each refined hypothesis, its cost and its coarse hypothesis; `instances` are the chosen rows.

    `fits` tell how well each of the instances fits the frame. If there was nothing to refine, only
    `looked_for` is there.
    """
    name = str(object_id)
    arrays: Arrays = {f"{name}/looked_for": np.array(True)}
    if refined is None:
        return arrays
    return arrays | {
        f"{name}/poses": np.stack([each.pose_cam_obj for each in refined.refined]),
        f"{name}/costs": refined.costs,
        f"{name}/sources": refined.sources,
        f"{name}/instances": np.array(refined.instances),
        f"{name}/fits": np.stack([fit.as_array() for fit in fits]),
    }


def regions_of(stored: Arrays, shape: tuple[int, int]) -> dict[int, Region]:
    """Regions by object id, from the arrays of a frame of that shape (h, w)."""
    regions = {}
    for entry in stored:
        name, _, field = entry.partition("/")
        if field != "mask":
            continue
        bits = np.unpackbits(stored[entry], count=shape[0] * shape[1])
        regions[int(name)] = Region(
            int(name),
            stored[f"{name}/centers"],
            stored[f"{name}/probabilities"],
            bits.reshape(shape).astype(bool),
        )
    return regions


def hypotheses_of(stored: Arrays, object_id: int) -> Hypotheses:
    """Hypotheses of an object, from a frame's arrays."""
    return Hypotheses(stored[f"{object_id}/poses"], stored[f"{object_id}/support"])


def votes_of(stored: Arrays, object_id: int) -> Votes:
    """Votes for an object, from a frame's arrays. Patches that cast none have no number."""
    name = str(object_id)
    pixels = stored[f"{name}/vote_pixels"].astype(np.float64)
    return Votes(
        stored[f"{name}/vote_centroids"],
        rotation_matrices(stored[f"{name}/vote_quaternions"]),
        stored[f"{name}/vote_weights"].astype(np.float64),
        np.unique(pixels, axis=0, return_inverse=True)[1].reshape(-1),
        pixels,
    )


def read_regions(folder: Path, frame: Frame) -> dict[int, Region]:
    """Candidate regions of the objects that were looked for in a frame, from disk."""
    return regions_of(read_arrays(folder, frame.key), (frame.depth.shape[0], frame.depth.shape[1]))
