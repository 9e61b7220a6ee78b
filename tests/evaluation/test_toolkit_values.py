"""HLP's errors, recalls and average precision are the BOP toolkit's, on values stored of it."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from make_toolkit_values import DELTAS, SHAPE, STEP, STORED, depth_of, pose_of
from ray_boxes import box_depth

from hlp.data.bop import BopSettings
from hlp.data.bop_models import symmetry_motions
from hlp.data.bop_scenes import most_visible
from hlp.evaluation import EvaluationSettings, bop_recalls, errors
from hlp.evaluation.average_precision import average_precision
from hlp.evaluation.evaluator import FrameTruth, score_targets
from hlp.records import Mesh, ObjectModel, PoseEstimate, Target
from hlp.results.recalls import average_recalls
from hlp.schemas import ModelInfo
from hlp.settings import read_settings

CONTENT = json.loads(STORED.read_text())
IMAGES = CONTENT["inputs"]["images"]
VALUES = CONTENT["values"]
STEPS = math.ceil(math.pi / STEP)


def _model(object_id, stated):
    vertices = np.array(stated["points"]) / 1000
    colors, faces = np.zeros(vertices.shape, np.uint8), np.zeros((0, 3), int)
    mesh = Mesh(vertices, faces, colors, np.zeros_like(vertices))
    given = {key: values for key, values in stated.items() if key.startswith("symm")}
    motions = symmetry_motions(read_settings(ModelInfo, given), STEPS)
    return ObjectModel(
        object_id, str(object_id), mesh, mesh, stated["diameter"] / 1000, motions, 0.1, 0.1
    )


MODELS = {int(i): _model(int(i), stated) for i, stated in CONTENT["inputs"]["objects"].items()}


def _pose(six):
    pose = pose_of(six)
    pose[:3, 3] /= 1000
    return pose


DEPTHS = [depth_of(image) / 1000 for image in IMAGES]


def _truths(localization):
    """The truth of each image; of localization, the instances that its list of targets counts."""
    for number, image in enumerate(IMAGES):
        targets = [Target(t["obj_id"], _pose(t["pose"]), t["visib_fract"]) for t in image["truths"]]
        if localization:
            seen = [t.object_id for t in targets if t.visible_fraction >= 0.1]
            targets = most_visible(targets, {i: seen.count(i) for i in seen}, "here")
        frame = SimpleNamespace(
            scene_id=1,
            frame_id=number,
            camera_matrix=np.array(image["cam_K"]),
            rgb=np.zeros((*SHAPE, 3), np.uint8),
            depth=DEPTHS[number],
            targets=tuple(targets),
        )
        yield FrameTruth.of(frame, with_depth=localization)


ESTIMATES = [
    PoseEstimate(1, number, answer["obj_id"], _pose(answer["pose"]), answer["score"])
    for number, image in enumerate(IMAGES)
    for answer in image["answers"]
]


@pytest.fixture
def _rays(monkeypatch):
    """Rendering without triangles, as the toolkit's values were made."""

    def rendered(mesh, poses, camera, shape, threads):
        extents = np.ptp(mesh.vertices, axis=0)
        return np.stack([box_depth(pose, extents, camera, shape, 0.0) for pose in poses])

    monkeypatch.setattr(bop_recalls, "render_depth", rendered)


def test_symmetries_have_as_many_steps_as_bops():
    assert BopSettings(root="").symmetry_steps == math.ceil(math.pi / 0.01)


@pytest.mark.usefixtures("_rays")
def test_errors_of_a_pose():
    for own in VALUES["errors"]:
        image = IMAGES[own["image"]]
        answer, truth = image["answers"][own["answer"]], image["truths"][own["truth"]]
        model, camera = MODELS[answer["obj_id"]], np.array(image["cam_K"])
        pair = _pose(answer["pose"]), _pose(truth["pose"])
        vertices = model.mesh.vertices
        assert errors.add(*pair, vertices) * 1000 == pytest.approx(own["add"], abs=1e-6)
        assert errors.add_s(*pair, vertices) * 1000 == pytest.approx(own["adi"], abs=1e-6)
        recalls = [bop_recalls.BopRecalls(model, model.mesh, delta / 1000) for delta in DELTAS]
        mssd, mspd = recalls[0].distances(pair[1:], pair[:1], camera)
        assert mssd.item() * 1000 == pytest.approx(own["mssd"], abs=1e-6)
        assert mspd.item() == pytest.approx(own["mspd"], abs=1e-6)
        for delta, own_recalls in zip(DELTAS, recalls, strict=True):
            vsd = own_recalls._vsd(*pair, camera, DEPTHS[own["image"]])
            np.testing.assert_allclose(vsd, own[f"vsd{delta}"], atol=1e-8)


@pytest.mark.usefixtures("_rays")
def test_average_recalls_of_several_instances_and_missing_answers():
    found = average_recalls(score_targets(_truths(True), MODELS, ESTIMATES, EvaluationSettings()))
    assert {name: found[name] for name in VALUES["recalls"]} == pytest.approx(VALUES["recalls"])


def test_average_precision_where_instances_are_hidden_and_answers_are_of_absent_objects():
    found = average_precision(_truths(False), MODELS, ESTIMATES)
    assert {name: found[name] for name in VALUES["precision"]} == pytest.approx(VALUES["precision"])
