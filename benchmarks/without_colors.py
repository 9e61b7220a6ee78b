"""Data sets whose CAD models have lost their colours, as an engineer's STL has none.

    python benchmarks/without_colors.py ../shared/data grey --sets lm cup mustard ycbv
    hlp -m experiment=recordings data=cup,mustard,ycbv data_folder=grey

Meshes keep vertices and faces alone; their objects are learnt and found by shape and edges. Images
and everything else are linked, other folders of the data folder too.
"""

import argparse
import shutil
from pathlib import Path

import trimesh


def main() -> None:
    """Link everything but the models, and write those without colours."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data_folder", type=Path, help="holds data sets in BOP's layout")
    parser.add_argument("output", type=Path, help="folder to write")
    parser.add_argument("--sets", nargs="+", required=True, help="those that lose their colours")
    given = parser.parse_args()
    for source in given.data_folder.resolve().iterdir():
        if source.name in given.sets:
            strip(source, given.output / source.name)
        elif source.is_dir():
            link(source, given.output / source.name)


def strip(source: Path, output: Path) -> None:
    """A data set without its models' colours."""
    for part in source.iterdir():
        if part.name not in ("models", "models_eval"):
            link(part, output / part.name)
    (output / "models").mkdir(parents=True, exist_ok=True)
    for file in (source / "models").iterdir():
        if file.suffix == ".ply":
            mesh = trimesh.load_mesh(file, process=False)
            plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
            plain.merge_vertices()  # seams of a texture
            plain.export(output / "models" / file.name, vertex_normal=False)
        elif file.suffix == ".json":
            shutil.copy(file, output / "models")


def link(source: Path, output: Path) -> None:
    """A link to a file or folder, where there is none yet."""
    output.parent.mkdir(parents=True, exist_ok=True)
    if not output.exists():
        output.symlink_to(source)


if __name__ == "__main__":
    main()
