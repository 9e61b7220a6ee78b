"""A frame's trace on disk: one file of arrays for each stage and frame, written whole or not.

Arrays of an object are named `ID/FIELD`; nobody else knows their names.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np

from hlp.errors import DataError, MissingFileError
from hlp.files import read_npz, replaced
from hlp.geometry import quaternions, rotation_matrices
from hlp.method.find.trace import ObjectTrace, Stage, Trace
from hlp.records import Hypotheses, Region, Votes
from hlp.refinement.choice import RefinedHypotheses
from hlp.refinement.pose_fit import PoseFit
from hlp.refinement.refiner import Refinement

Arrays = dict[str, np.ndarray]
_FAILED, _OWNER = "failed", "owner"


def write_arrays(folder: Path, key: str, arrays: Arrays) -> None:
    """Write `key`.npz. After a crash or on a full disk there is no partial file of that name.

    The file says whose it is, and the archive holds a checksum of each array.
    """
    with replaced(folder / f"{key}.npz") as stream:
        owner = np.array(_owner(folder, key))
        np.savez_compressed(stream, **arrays, **{_OWNER: owner})  # type: ignore[arg-type]


def read_arrays(folder: Path, key: str) -> Arrays:
    """Read what `write_arrays` wrote.

    Raises DataError naming a file that is damaged, or that is of another frame or output.
    """
    path = folder / f"{key}.npz"
    arrays = read_npz(path)
    if str(arrays.pop(_OWNER, "")) != _owner(folder, key):
        raise DataError(f"{path} is of another frame: delete its folder to make it again")
    return arrays


def _owner(folder: Path, key: str) -> str:
    """Stage, fingerprint and frame; the folder's name ends differently while it is being made."""
    return f"{folder.parent.name}/{folder.name.partition('.')[0]}/{key}"


def has_arrays(folder: Path, key: str) -> bool:
    """Whether `key`.npz is there and sound.

    After a crash of the machine a file that was written last can be empty or damaged.
    """
    try:
        read_arrays(folder, key)
    except (MissingFileError, DataError):
        return False
    return True


def write_failure(folder: Path, key: str, reason: str) -> None:
    """Write why a frame could not be used, in place of its trace."""
    write_arrays(folder, key, {_FAILED: np.array(reason)})


def write_trace(folder: Path, key: str, stage: Stage, trace: Trace) -> None:
    """Write what a stage has found in a frame."""
    encode = {"regions": _region_arrays, "hypotheses": _coarse_arrays, "poses": _refined_arrays}
    arrays: Arrays = {}
    for object_id, found in trace.items():
        arrays |= {f"{object_id}/{name}": values for name, values in encode[stage](found).items()}
    write_arrays(folder, key, arrays)


def read_trace(
    folders: Mapping[Stage, Path], key: str, stages: Sequence[Stage] | None = None
) -> Trace | str:
    """What stages (default: all that have a folder) have found in a frame; or why it failed.

    Patches, iterations and seconds are not kept. Raises DataError naming a damaged file.
    """
    decode = {"regions": _with_region, "hypotheses": _with_coarse, "poses": _with_refined}
    trace: dict[int, ObjectTrace] = {}
    for stage in folders if stages is None else stages:
        stored = read_arrays(folders[stage], key)
        if _FAILED in stored:
            return str(stored[_FAILED])
        by_object: dict[int, Arrays] = {}
        for name, values in stored.items():
            object_id, _, field = name.partition("/")
            by_object.setdefault(int(object_id), {})[field] = values
        for number, fields in by_object.items():
            trace[number] = decode[stage](trace.get(number, ObjectTrace()), fields, number)
    return trace


def _region_arrays(found: ObjectTrace) -> Arrays:
    """A region, its mask packed into bits."""
    region = found.region
    assert region is not None
    return {
        "centers": region.centers.astype(np.float32),
        "probabilities": region.probabilities.astype(np.float32),
        "mask": np.packbits(region.mask),
        "shape": np.array(region.mask.shape),
    }


def _with_region(found: ObjectTrace, arrays: Arrays, object_id: int) -> ObjectTrace:
    height, width = arrays["shape"].tolist()
    mask = np.unpackbits(arrays["mask"], count=height * width).reshape(height, width).astype(bool)
    centers = arrays["centers"].astype(np.float64)
    return replace(found, region=Region(object_id, centers, arrays["probabilities"], mask))


def _coarse_arrays(found: ObjectTrace) -> Arrays:
    """Hypotheses and votes. Votes are in single precision, which is exact to a micrometre."""
    hypotheses, votes = found.hypotheses, found.votes
    assert hypotheses is not None and votes is not None
    return {
        "poses": hypotheses.poses_cam_obj,
        "support": hypotheses.support,
        "vote_centroids": votes.centroids_cam.astype(np.float32),
        "vote_quaternions": quaternions(votes.rotations_cam_obj).astype(np.float32),
        "vote_weights": votes.weights.astype(np.float32),
        "vote_pixels": np.rint(votes.pixels).astype(np.int16),
    }


def _with_coarse(found: ObjectTrace, arrays: Arrays, _: int) -> ObjectTrace:
    """Patches that cast no vote have no number."""
    pixels = arrays["vote_pixels"].astype(np.float64)
    patches = np.unique(pixels, axis=0, return_inverse=True)[1].reshape(-1)
    rotations = rotation_matrices(arrays["vote_quaternions"])
    weights = arrays["vote_weights"].astype(np.float64)
    votes = Votes(arrays["vote_centroids"], rotations, weights, patches, pixels)
    return replace(found, votes=votes, hypotheses=Hypotheses(arrays["poses"], arrays["support"]))


def _refined_arrays(found: ObjectTrace) -> Arrays:
    """If there was nothing to refine, only `looked_for` is there."""
    arrays: Arrays = {"looked_for": np.array(True)}
    refined = found.refined
    if refined is None:
        return arrays
    return arrays | {
        "poses": np.stack([pose.pose_cam_obj for pose in refined.refined]),
        "costs": refined.costs,
        "sources": refined.sources,
        "starts": refined.starts,
        "instances": np.array(refined.instances),
        "fits": np.array([astuple(fit) for fit in found.fits]),
    }


def _with_refined(found: ObjectTrace, arrays: Arrays, _: int) -> ObjectTrace:
    if "poses" not in arrays:
        return found
    poses = [Refinement(pose, 0) for pose in arrays["poses"]]
    costs, sources, starts = (arrays[name] for name in ("costs", "sources", "starts"))
    refined = RefinedHypotheses(poses, costs, sources, starts, tuple(arrays["instances"].tolist()))
    fits = tuple(PoseFit(*fit) for fit in arrays["fits"].tolist())
    return replace(found, refined=refined, fits=fits)
