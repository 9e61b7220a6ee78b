"""Several instances of one object in a frame: each is chosen once, on pixels of its own."""

import numpy as np

from hlp.geometry import transform
from hlp.refinement.pso import PsoSettings
from hlp.refinement.refiner import NoneSettings, Refinement
from hlp.refinement.verification import Verifier, observe
from hlp.rendering.rasterizer import render_scene
from hlp.rendering.shading import FRONTAL_LIGHT
from refinement_scene import CAMERA, SHAPE, disturbed, search_of


def find(row, poses, verification, count, settings=None, **given):
    refiner = (settings or NoneSettings()).build(1)
    return search_of(row[0], verification, refiner, poses, **given).find(count)


def centres(row, found):
    poses = np.stack([found.refined[i].pose_cam_obj for i in found.instances])
    return transform(poses, row[0].model.centroid[None])[:, 0]


def test_every_instance_is_found_once(row, verification):
    """Though the hypotheses near the first one all cost less than those of the last, hidden one."""
    poses = np.concatenate(
        [[disturbed(scene, 1.0 + k, 1.0 + k, seed=k) for k in range(5)] for scene in row]
    )
    settings = PsoSettings(particles=15, iterations=15)
    found = find(row, poses, verification, 3, settings=settings)
    assert len(found.instances) == 3 == len(set(found.instances))
    true = transform(np.stack([scene.pose for scene in row]), row[0].model.centroid[None])[:, 0]
    order = np.argsort(centres(row, found)[:, 0])
    np.testing.assert_allclose(centres(row, found)[order], true, atol=0.006)
    # The least hidden ones first; each cost is that of its own pose.
    costs = found.costs[list(found.instances)]
    assert (costs < 0.3).all() and costs[2] > costs[:2].max()


def test_there_are_no_more_instances_than_things_to_stand_on(row, verification):
    """Hypotheses on explained pixels are no further instance, however many are asked for."""
    poses = np.stack([disturbed(row[1], 2.0 * k, 2.0 * k, seed=k) for k in range(6)])
    found = find(row, poses, verification, 4)
    assert len(found.instances) == 1


class Attracted:
    """Whatever it refines becomes one pose."""

    def __init__(self, pose):
        self._refined = Refinement(pose, 1)

    def build(self, threads):
        return self

    def refine(self, _model, _seen, batch, *_):
        return [self._refined] * len(batch.poses_cam_obj)

    def second_search(self, *_):
        return self._refined


def test_what_is_refined_onto_a_chosen_instance_is_never_the_cheapest(row, verification):
    """Then no free pose is left, though more were refined; each of them has a cost."""
    poses = np.stack([row[1].pose, row[1].pose, disturbed(row[0], 2.0, 2.0, seed=1)])
    attracted = Attracted(row[1].pose)
    found = find(row, poses, verification, 2, settings=attracted, max_improvement=0.0)
    assert len(found.instances) == 1 and len(found.refined) == 3
    assert np.isfinite(found.costs[:2]).all() and np.isinf(found.costs[2:]).all()
    assert len(found.costs) == len(found.sources) == 3


def test_the_first_instance_does_not_depend_on_how_many_are_asked_for(row, verification):
    poses = np.stack([disturbed(scene, 3.0, 3.0, seed=k) for k, scene in enumerate(row)])
    one, three = (find(row, poses, verification, count) for count in (1, 3))
    assert len(one.instances) == 1 and len(three.instances) == 3
    first, again = (each.refined[each.instances[0]].pose_cam_obj for each in (one, three))
    np.testing.assert_array_equal(first, again)
    assert one.costs[one.instances[0]] == three.costs[three.instances[0]]


def test_explained_pixels_have_no_depth_and_others_keep_theirs(row, verification):
    scene = row[1]
    verifier = Verifier(scene.model, verification)
    before = observe(scene.rgb, scene.depth, CAMERA, verification)
    after = verifier.without_explained(before, scene.pose)
    alone = render_scene([(scene.model.mesh, scene.pose)], CAMERA, SHAPE, FRONTAL_LIGHT)[1]
    agree = (alone > 0) & (np.abs(alone - scene.depth) <= verification.tau_depth_mm / 1000)
    np.testing.assert_array_equal(after.depth, np.where(agree, 0.0, scene.depth))
    assert verifier.evidence(after, scene.pose[None]).area[0] == 0.0
    others = np.stack([row[0].pose, row[2].pose])
    np.testing.assert_array_equal(
        verifier.evidence(after, others).area, verifier.evidence(before, others).area
    )


def test_only_a_search_without_known_number_is_kept_short(row, verification):
    """Of eight free hypotheses for the second instance, all are refined if it is known to exist."""
    poses = np.stack([row[0].pose, *(disturbed(row[1], 6.0, 6.0, seed=k) for k in range(8))])
    known = find(row, poses, verification, 2)
    open_end = find(row, poses, verification, 2, score=lambda _: 0.8)
    assert len(open_end.refined) < len(known.refined) == 9


def test_an_instance_that_is_not_good_enough_is_the_last(row, verification):
    poses = np.stack([disturbed(scene, 3.0, 3.0, seed=k) for k, scene in enumerate(row)])
    scores = iter([0.8, 0.8] + [0.0] * 9)  # the first one is asked for twice: also if it is sure
    found = find(row, poses, verification, 3, score=lambda _: next(scores))
    assert len(found.instances) == 2


def test_a_further_instance_is_given_up_where_the_first_poses_are_hopeless(row, verification):
    """Two more are refined then instead of four, after the two of the first instance."""
    poses = np.stack([row[0].pose, *(disturbed(row[1], 6.0, 6.0, seed=k) for k in range(8))])
    hopeless, doubtful = (
        find(row, poses, verification, 2, score=lambda p, s=s: 0.8 if (p == poses[0]).all() else s)
        for s in (0.05, 0.2)
    )
    assert (len(hopeless.refined), len(doubtful.refined)) == (4, 6)
    assert len(hopeless.instances) == len(doubtful.instances) == 2
