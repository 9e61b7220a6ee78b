"""Mesh files, and the smallest settings of the method, for tests that learn an object."""

import shutil
from pathlib import Path

import pytest
import trimesh

from composed_settings import run_settings
from hlp.data.synthetic.objects import demo_objects
from hlp.method.settings import MethodSettings
from hlp.records import ObjectModel

MODELS = {model.name: model for model in demo_objects().values()}
"""The demo's objects by name."""
TINY = (
    "encoder=pca",
    "codebook=exact",
    "rendering.viewpoints=40",
    "rendering.in_plane_steps=4",
    "rendering.size_px=64",
    "patches.pool.per_object=200",
    "patches.pool.backgrounds=200",
    "patches.pool.distractor_scenes=2",
    "patches.pairs.per_object=200",
    "classifier.epochs=3",
    "classifier.min_batches=0",
)
LEARNS_WELL = (
    *("rendering.coverage=hemisphere", "rendering.in_plane_min_deg=-45"),
    *("rendering.in_plane_max_deg=45", "rendering.in_plane_steps=7"),
    *("patches.pool.per_object=900", "patches.pairs.per_object=600"),
    *("patches.pool.distractor_scenes=10", "classifier.epochs=4", "classifier.min_batches=60"),
)
"""What finds the demo's objects for sure, after a minute of learning."""


def tiny_method(*overrides: str) -> MethodSettings:
    """The default method made small: PCA in place of a trained encoder, few views."""
    return run_settings(*TINY, *overrides).method


def write_mesh(folder: Path, model: ObjectModel) -> Path:
    """The object's mesh as a PLY file of its name."""
    return export_mesh(folder / f"{model.name}.ply", model)


def export_mesh(path: Path, model: ObjectModel) -> Path:
    """The object's mesh as a file in millimetres."""
    mesh = trimesh.Trimesh(
        model.mesh.vertices * 1000.0,
        model.mesh.faces,
        vertex_normals=model.mesh.normals,
        vertex_colors=model.mesh.colors,
        process=False,
    )
    mesh.export(path)
    return path


def write_meshes(folder: Path, *names: str) -> dict[str, Path]:
    """Meshes of the demo's objects by name."""
    return {name: write_mesh(folder, MODELS[name]) for name in names}


def train_nothing(patch: pytest.MonkeyPatch, learnt: Path) -> None:
    """Learning copies the classifier of a learnt folder."""

    def copy(*given: object) -> None:
        shutil.copytree(learnt / "classifier", str(given[4]), dirs_exist_ok=True)

    patch.setattr("hlp.method.learn.learning.train_classifier", copy)
