"""Mesh files, and the smallest settings of the method, for tests that learn an object."""

from functools import cache
from pathlib import Path

import trimesh

from hlp.commands.composing import compose_config
from hlp.config.build import build_settings
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
    "score.scenes=2",
    "classifier.min_batches=0",
)


@cache
def tiny_method(*overrides: str) -> MethodSettings:
    """The default method made small: PCA in place of a trained encoder, few views."""
    return build_settings(compose_config("output=out", *TINY, *overrides)).method


def write_mesh(folder: Path, model: ObjectModel) -> Path:
    """The object's mesh as a PLY file in millimetres."""
    mesh = trimesh.Trimesh(
        model.mesh.vertices * 1000.0,
        model.mesh.faces,
        vertex_normals=model.mesh.normals,
        vertex_colors=model.mesh.colors,
        process=False,
    )
    path = folder / f"{model.name}.ply"
    mesh.export(path)
    return path
