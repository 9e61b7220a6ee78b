import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid
from hlp.refinement.refiner import NoneSettings
from hlp.studies.basin import BasinSettings, perturbation_grid

NONE = NoneSettings()
TASK = BasinSettings("basin", ("none",), None, (0.0, 30.0), (0.0, 10.0, 50.0), 4, {"none": NONE})
TRUE = rigid(Rotation.from_euler("xyz", [0.4, 0.2, 0.1]).as_matrix(), np.array([0.1, 0.0, 0.8]))
CENTROID = np.array([0.03, -0.02, 0.05])


def centre(pose):
    return pose[:3, :3] @ CENTROID + pose[:3, 3]


def test_every_cell_of_the_grid_has_its_own_errors():
    perturbations = perturbation_grid(TASK, TRUE, CENTROID, 7)
    assert perturbations.shape == (2, 3, 4, 4, 4)
    for i, degrees in enumerate(TASK.rotation_deg):
        for j, millimetres in enumerate(TASK.translation_mm):
            for start in perturbations[i, j]:
                turn = Rotation.from_matrix(start[:3, :3] @ TRUE[:3, :3].T).magnitude()
                assert np.rad2deg(turn) == pytest.approx(degrees, abs=1e-6)
                moved = np.linalg.norm(centre(start) - centre(TRUE))
                assert moved * 1e3 == pytest.approx(millimetres, abs=1e-9)
    assert len(np.unique(perturbations[1, 2].reshape(4, -1), axis=0)) == 4
    np.testing.assert_array_equal(perturbations, perturbation_grid(TASK, TRUE, CENTROID, 7))
    assert not np.allclose(perturbations[1:], perturbation_grid(TASK, TRUE, CENTROID, 8)[1:])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"compared": ("pso",)}, r"^compared names 'pso': choose of none$"),
        ({"compared": ()}, r"^compared is \[\]: .*one at least"),
        ({"compared": ("none", "none")}, r"^compared is .*each once"),
        ({"rotation_deg": ()}, r"^rotation_deg is \[\]"),
        ({"rotation_deg": (0.0, -1.0)}, r"^rotation_deg\.1 is -1\.0: it must be at least 0"),
        ({"translation_mm": (float("nan"),)}, r"^translation_mm\.0 is nan: .* a finite number"),
    ],
)
def test_a_list_that_cannot_be_worked_with_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(TASK, **change)


def test_directions_favour_none_and_differ():
    count = 4000
    changed = {"rotation_deg": (20.0,), "translation_mm": (10.0,), "perturbations": count}
    starts = perturbation_grid(dataclasses.replace(TASK, **changed), TRUE, CENTROID, 1)[0, 0]
    shifts = np.array([centre(start) - centre(TRUE) for start in starts]) * 100.0
    axes = Rotation.from_matrix(starts[:, :3, :3] @ TRUE[:3, :3].T).as_rotvec() / np.deg2rad(20.0)
    for directions in (shifts, axes):
        # Uniform on the sphere: mean 0, and the mean of the outer products a third of the identity.
        np.testing.assert_allclose(directions.mean(axis=0), 0.0, atol=0.04)
        np.testing.assert_allclose(directions.T @ directions / count, np.eye(3) / 3, atol=0.03)
    assert abs(np.einsum("ni,ni->n", shifts, axes).mean()) < 0.05
