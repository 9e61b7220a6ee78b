"""Reference values of the BOP toolkit for test_toolkit_values.py: errors, recalls, precision.

    python3 -m venv env && env/bin/pip install 'numpy<2' scipy pytz
    env/bin/python tests/evaluation/make_toolkit_values.py TOOLKIT

TOOLKIT is a checkout of github.com/thodan/bop_toolkit. The stored values are those of its files as
of pose_error.py 2fe516b, misc.py 0b7c901, visibility.py 91d9d70, pose_matching.py 08c3930, score.py
aea87ef and transform.py 8a0afcd (NumPy 1.26). Between their functions, this does what the scripts
eval_calc_errors.py (4b88ec6) and eval_calc_scores.py (08c3930) do. Lengths are in millimetres.
"""

import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from ray_boxes import box_depth, scene_depth
from scipy.spatial.transform import Rotation

STORED = Path(__file__).with_name("toolkit_values.json")
SHAPE = (120, 160)
DELTAS = (15, 5)  # of VSD; 5 is ITODD's
STEP = 0.3  # of rotations about an axis of symmetry; BOP's own is 0.01
THRESHOLDS = np.arange(0.05, 0.51, 0.05)
HALF_TURN = [-1, 0, 0, 2, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
UPSIDE_DOWN = [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 3, 0, 0, 0, 1]
BOXES = {  # extents, and symmetries as in models_info.json
    1: ([60, 80, 100], {}),
    2: ([50, 40, 30], {"symmetries_discrete": [HALF_TURN]}),
    3: (
        [70, 70, 40],
        {
            "symmetries_discrete": [UPSIDE_DOWN],
            "symmetries_continuous": [{"axis": [0, 0, 1], "offset": [1, 2, 0]}],
        },
    ),
    4: ([40, 40, 40], {}),  # in no image
}


def pose_of(six):
    """A pose (4, 4) from rotation vector and translation."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(six[:3]).as_matrix(), six[3:]
    return pose


def depth_of(image):
    """The depth image (mm) of an image's instances."""
    boxes = [(pose_of(t["pose"]), BOXES[t["obj_id"]][0]) for t in image["truths"]]
    return scene_depth(boxes, np.array(image["cam_K"]), SHAPE, image["occluded"], image["hole"])


def rounded(values, digits):
    """Plain numbers."""
    return np.round(values, digits).tolist()


def make_inputs(images=6, seed=34):
    """Objects, and images with instances, of which some are hidden, and with answers.

    Answers are near, far, turned by symmetries, missing, and of objects that are not there.
    """
    rng = np.random.default_rng(seed)
    objects = {}
    for object_id, (extents, symmetries) in BOXES.items():
        corners = np.array(np.meshgrid(*([-1, 1],) * 3)).reshape(3, -1).T
        inside = rng.uniform(-1, 1, (12, 3))
        points = rounded(np.concatenate([corners, inside]) * extents / 2, 1)
        diameter = round(float(np.linalg.norm(extents)), 3)
        objects[object_id] = {"extents": extents, "points": points, "diameter": diameter}
        objects[object_id].update(symmetries)
    return {"objects": objects, "images": [_image(rng, number) for number in range(images)]}


def _image(rng, number):
    focal, center = rng.uniform(180, 200, 2), rng.uniform([75, 55], [85, 65])
    camera = [[focal[0], 0, center[0]], [0, focal[1], center[1]], [0, 0, 1]]
    truths, answers = [], []
    for object_id in (1, 2, 3):
        for _ in range(rng.integers(0, 4) if number else 0):
            pose, seen = _anywhere(rng), float(rng.choice([0.05, 0.3, 0.6, 1.0]))
            truths.append({"obj_id": object_id, "pose": pose, "visib_fract": seen})
            for spread in rng.choice([1, 3, 10, 30], rng.integers(0, 3)):
                near = pose_of(pose) @ pose_of(rng.normal(0, spread, 6) * ([0.01] * 3 + [1] * 3))
                if object_id == 2 and rng.random() < 0.5:
                    near = near @ np.reshape(HALF_TURN, (4, 4))
                elif object_id == 3:
                    near = near @ pose_of([0, 0, rng.uniform(-3, 3), 0, 0, 0])
                turn = Rotation.from_matrix(near[:3, :3]).as_rotvec()
                answers.append((object_id, rounded([*turn, *near[:3, 3]], 5)))
    answers += [(object_id, _anywhere(rng)) for object_id in BOXES if rng.random() < 0.5]
    scores = rng.permutation(1000)[: len(answers)] / 1000
    return {
        "cam_K": rounded(camera, 3),
        "occluded": int(rng.choice([0, 60])),
        "hole": int(rng.choice([70, 120])),
        "truths": truths,
        "answers": [
            {"obj_id": object_id, "score": float(score), "pose": pose}
            for (object_id, pose), score in zip(answers, scores, strict=True)
        ],
    }


def _anywhere(rng):
    turn = Rotation.from_rotvec(rng.normal(0, 1, 3)).as_rotvec()
    return rounded([*turn, *rng.uniform([-150, -100, 700], [150, 100, 1000])], 5)


class Rays:
    """Stands for the toolkit's renderer, which samples pixel i at i + 0.5."""

    def render_object(self, object_id, turn, shift, fx, fy, cx, cy):
        """The depth of a box."""
        pose, camera = np.eye(4), np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        pose[:3, :3], pose[:3, 3] = turn, shift.ravel()
        return {"depth": box_depth(pose, BOXES[object_id][0], camera, SHAPE, 0.5)}


def errors_of(inputs):
    """All errors of each answer against each instance of its object, by image, answer, instance."""
    from bop_toolkit_lib import misc, pose_error

    objects = inputs["objects"]
    alike = {i: misc.get_symmetry_transformations(own, STEP) for i, own in objects.items()}
    found = {}
    for number, image in enumerate(inputs["images"]):
        camera, truths = np.array(image["cam_K"]), [pose_of(t["pose"]) for t in image["truths"]]
        depth = depth_of(image)
        for a, answer in enumerate(image["answers"]):
            object_id, pose = answer["obj_id"], pose_of(answer["pose"])
            own = objects[object_id]
            points = np.array(own["points"])
            for g, true in enumerate(truths):
                if image["truths"][g]["obj_id"] != object_id:
                    continue
                both = pose[:3, :3], pose[:3, 3:], true[:3, :3], true[:3, 3:]
                values = {
                    "mssd": pose_error.mssd(*both, points, alike[object_id]),
                    "mspd": pose_error.mspd(*both, camera, points, alike[object_id]),
                    "add": pose_error.add(*both, points),
                    "adi": pose_error.adi(*both, points),
                }
                near = misc.overlapping_sphere_projections(
                    own["diameter"] / 2, pose[:3, 3], true[:3, 3]
                )
                for delta in DELTAS:
                    given = depth, camera, delta, THRESHOLDS, True, own["diameter"]
                    vsd = pose_error.vsd(*both, *given, Rays(), object_id) if near else [1.0] * 10
                    values[f"vsd{delta}"] = rounded(vsd, 9)
                found[number, a, g] = values
    return found


def matches_of(inputs, errors, error, limit, counted):
    """The toolkit's matches and errors; `counted` are the answers and instances that count."""
    from bop_toolkit_lib import pose_matching

    listed, truths, infos, valid = [], {}, {}, {}
    for number, image in enumerate(inputs["images"]):
        truths[number] = infos[number] = image["truths"]
        answers, valid[number] = counted(image)
        for a in answers:
            answer = image["answers"][a]
            there = {
                g: [error(errors[number, a, g], answer["obj_id"])]
                for g, truth in enumerate(image["truths"])
                if truth["obj_id"] == answer["obj_id"]
            }
            seen = {g: image["truths"][g]["visib_fract"] for g in there}
            own = {"scene_id": 1, "im_id": number, "est_id": a, "errors": there}
            listed.append({**own, **answer, "gt_visib_fracts": seen})
    given = 1, truths, infos, valid, listed, [limit]
    return pose_matching.match_poses_scene(*given, 0), listed


def localization(image):
    """As many of the surest answers for an object as it has visible instances, which count."""
    counts = Counter(t["obj_id"] for t in image["truths"] if t["visib_fract"] >= 0.1)
    answers = sorted(range(len(image["answers"])), key=lambda a: -image["answers"][a]["score"])
    kept = [
        a
        for object_id, count in counts.items()
        for a in [a for a in answers if image["answers"][a]["obj_id"] == object_id][:count]
    ]
    return kept, [truth["visib_fract"] >= 0.1 for truth in image["truths"]]


def detection(image):
    """The answers for all objects that the image shows, and all its instances."""
    there = {truth["obj_id"] for truth in image["truths"]}
    kept = [a for a, answer in enumerate(image["answers"]) if answer["obj_id"] in there]
    return kept, [True] * len(image["truths"])


def values_of(inputs):
    """Errors, average recalls, and average precision by object."""
    from bop_toolkit_lib import score

    errors, ids = errors_of(inputs), list(BOXES)
    diameters = {i: own["diameter"] for i, own in inputs["objects"].items()}
    scale = 640 / SHAPE[1]
    measures = {
        "mssd": (lambda e, i: e["mssd"] / diameters[i], THRESHOLDS),
        "mspd": (lambda e, i: e["mspd"] * scale, np.arange(5, 51, 5)),
        "mssd_mm": (lambda e, i: e["mssd"], np.arange(2, 21, 2)),
    }
    taus = {t: (lambda e, i, t=t: e["vsd15"][t], THRESHOLDS) for t in range(10)}
    recalls, precision = {}, {}
    for name, tried in {"vsd": taus, **{n: {n: measures[n]} for n in ("mssd", "mspd")}}.items():
        found = [
            score.calc_localization_scores(
                [1], ids, matches_of(inputs, errors, error, limit, localization)[0], -1, False
            )["recall"]
            for error, limits in tried.values()
            for limit in limits
        ]
        recalls[name] = float(np.mean(found))
    for name, (error, limits) in measures.items():
        found = []
        for limit in limits:
            matches, listed = matches_of(inputs, errors, error, limit, detection)
            scores = score.calc_pose_detection_scores([1], ids, matches, listed, 0.1, False)
            counts = scores["num_targets_per_object"]
            found.append([scores["scores"][i] for i in ids if counts[i] > 0])
        precision[name] = float(np.mean(np.mean(found, axis=0)))
    pairs = [{"image": n, "answer": a, "truth": g, **own} for (n, a, g), own in errors.items()]
    return {"errors": pairs, "recalls": recalls, "precision": precision}


if __name__ == "__main__":
    sys.path.insert(0, sys.argv[1])
    made = make_inputs()
    STORED.write_text(json.dumps({"inputs": made, "values": values_of(made)}) + "\n")
