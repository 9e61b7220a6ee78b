"""Small copies of BOP's seven core data sets: rendered frames in the layout of each of them.

What differs between the sets is kept: names of folders and files, formats, units of depth, which
models have colours, whether true poses are given, how often an object stands in an image.
"""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from frame_files import camera_entry, pose_entry
from hlp.data.synthetic.bins import BinSettings
from hlp.data.synthetic.scenes import SyntheticSettings
from hlp.records import Frame, Mesh, ObjectModel
from tiny_run import TINY

SMALLEST = (
    *(word for word in TINY if not word.startswith(("data.", "frames=", "panels="))),  # the demo's
    *("panels=0", "output=out", "reporting=none", "machine.threads=2"),
)
"""What makes `experiment=bop` as short as it can be on these sets."""
BOWL = 2
"""The demo object that is symmetric."""


@dataclass(frozen=True)
class Layout:
    """What one of BOP's data sets looks like on disk.

    `models` are folders with meshes and whether these have colours: "vertices", "texture" or none.
    `splits` are folders with images and whether true poses are given for them. `depth_scale` is the
    length (mm) of a unit of depth. With `bin` several of the same parts lie in the images. `scenes`
    has so many images in each scene.
    """

    splits: dict[str, bool]
    models: dict[str, str | None]
    color: str = "rgb/png"
    depth: str = "png"
    depth_scale: float = 1.0
    bin: bool = False
    scenes: tuple[int, ...] = (3,)


_COLORED = {"models": "vertices", "models_eval": None}
LAYOUTS = {
    "lmo": Layout({"test": True}, _COLORED),
    "tless": Layout(
        {"test_primesense": True},
        {"models_cad": None, "models_reconst": "vertices", "models_eval": None},
        depth_scale=0.1,
        bin=True,
        scenes=(2, 1),
    ),
    "tudl": Layout({"test": True}, _COLORED, scenes=(1, 1, 1)),
    "icbin": Layout({"test": True}, _COLORED, depth_scale=0.1, bin=True),
    "itodd": Layout(
        {"test": False, "val": True}, {**_COLORED, "models": None}, "gray/tif", "tif", 0.1, True
    ),
    "hb": Layout({"test_primesense": False, "val_primesense": True}, _COLORED, scenes=(2, 1)),
    "ycbv": Layout(
        {"test": True}, {"models": "texture", "models_eval": None}, depth_scale=0.1, scenes=(1, 2)
    ),
}


def write_bop_set(name: str, root: Path, width: int = 320) -> Layout:
    """Write the set of this name into `root`, with two objects or parts and three images a split.

    Each image has a camera of its own, the last one no depth at all. The list of targets for
    localization names numbers of instances, that for detection the images alone.
    """
    layout = LAYOUTS[name]
    few = {"objects": (4, 4), "clutter": (1, 1)} if layout.bin else {}  # to drop one takes a while
    settings = BinSettings if layout.bin else SyntheticSettings
    data = settings(scenes=3, width=width, seed=3, **few).build()
    frames = [
        _cropped(data.frames.load(key), 4 * number) for number, key in enumerate(data.frames.keys)
    ]
    often = Counter(i for frame in frames[:2] for i in {t.object_id for t in frame.targets})
    others = [i for i, _ in often.most_common() if layout.bin or i != BOWL]
    kept = sorted(others[:2] if layout.bin else [BOWL, others[0]])
    for folder, colors in layout.models.items():
        _write_models(root / folder, [data.models[i] for i in kept], colors)
    for split, annotated in layout.splits.items():
        _write_split(root, split, layout, frames, kept, annotated)
    return layout


def _cropped(frame: Frame, offset: int) -> Frame:
    """The part of a frame from this row and column on, so that cameras differ, not sizes."""
    rows, columns = (slice(offset, length - 8 + offset) for length in frame.depth.shape)
    camera = frame.camera_matrix.copy()
    camera[:2, 2] -= offset
    images = {"rgb": frame.rgb[rows, columns], "depth": frame.depth[rows, columns]}
    return replace(frame, camera_matrix=camera, **images)


def _write_models(folder: Path, models: Sequence[ObjectModel], colors: str | None) -> None:
    folder.mkdir(parents=True)
    infos = {}
    for model in models:
        name = f"obj_{model.object_id:06d}"
        _write_ply(folder / f"{name}.ply", model.mesh, colors)
        infos[str(model.object_id)] = {"diameter": model.diameter * 1000}
        if len(model.symmetries) > 1:
            axis = {"axis": [0, 0, 1], "offset": [0, 0, 0]}
            infos[str(model.object_id)]["symmetries_continuous"] = [axis]
    (folder / "models_info.json").write_text(json.dumps(infos))


def _write_ply(path: Path, mesh: Mesh, colors: str | None) -> None:
    """As BOP's: text, millimetres, normals; colours at vertices, or a texture beside the file."""
    columns = {"x y z": mesh.vertices * 1000, "nx ny nz": mesh.normals}
    kinds = dict.fromkeys(["x", "y", "z", "nx", "ny", "nz"], "float")
    comment = ""
    if colors == "vertices":
        columns["red green blue"] = mesh.colors
        kinds |= dict.fromkeys(("red", "green", "blue"), "uchar")
    if colors == "texture":
        palette, number = np.unique(mesh.colors, axis=0, return_inverse=True)
        cv2.imwrite(str(path.with_suffix(".png")), palette[None, :, ::-1])
        across = (number.ravel() + 0.5) / len(palette)
        columns["texture_u texture_v"] = np.stack([across, np.full(len(across), 0.5)], axis=1)
        kinds |= {"texture_u": "float", "texture_v": "float"}
        comment = f"comment TextureFile {path.stem}.png\n"
    names = " ".join(columns).split()
    header = "".join(f"property {kinds[name]} {name}\n" for name in names)
    rows = np.concatenate([*columns.values()], axis=1)
    whole = [kinds[name] == "uchar" for name in names]
    lines = [
        " ".join(str(int(v)) if w else f"{v:.4f}" for v, w in zip(row, whole, strict=True))
        for row in rows
    ]
    lines += [f"3 {a} {b} {c}" for a, b, c in mesh.faces]
    path.write_text(
        f"ply\nformat ascii 1.0\n{comment}element vertex {len(rows)}\n{header}"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        + "\n".join(lines)
        + "\n"
    )


def _write_split(
    root: Path,
    split: str,
    layout: Layout,
    frames: Sequence[Frame],
    kept: Sequence[int],
    annotated: bool,
) -> None:
    places = [(scene, i) for scene, n in enumerate(layout.scenes, 1) for i in range(n)]
    localization, detection = [], []
    for number, ((scene, image), frame) in enumerate(zip(places, frames, strict=True)):
        folder = root / split / f"{scene:06d}"
        targets = [target for target in frame.targets if target.object_id in kept]
        _write_images(folder, image, frame, layout, without_depth=number == len(frames) - 1)
        _add(folder / "scene_camera.json", image, camera_entry(frame, layout.depth_scale))
        if annotated:
            _add(folder / "scene_gt.json", image, [pose_entry(target) for target in targets])
            info = [{"visib_fract": round(t.visible_fraction, 4)} for t in targets]
            _add(folder / "scene_gt_info.json", image, info)
        place = {"scene_id": scene, "im_id": image}
        detection.append(place)
        for object_id in kept:
            if count := sum(target.object_id == object_id for target in targets):
                localization.append({**place, "obj_id": object_id, "inst_count": count})
    kind = split.partition("_")[0]
    (root / f"{kind}_targets_bop19.json").write_text(json.dumps(localization))
    (root / f"{kind}_targets_bop24.json").write_text(json.dumps(detection))


def _write_images(
    folder: Path, image: int, frame: Frame, layout: Layout, without_depth: bool
) -> None:
    kind, extension = layout.color.split("/")
    (folder / kind).mkdir(parents=True, exist_ok=True)
    (folder / "depth").mkdir(exist_ok=True)
    pixels = frame.rgb[..., ::-1]
    if kind == "gray":
        pixels = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY)
    cv2.imwrite(str(folder / kind / f"{image:06d}.{extension}"), pixels)
    raw = np.rint(frame.depth * 1000 / layout.depth_scale).astype(np.uint16)
    depth = np.zeros_like(raw) if without_depth else raw
    cv2.imwrite(str(folder / "depth" / f"{image:06d}.{layout.depth}"), depth)


def _add(path: Path, image: int, entry: object) -> None:
    """Add what is stated of an image to a file of its scene."""
    content = json.loads(path.read_text()) if path.is_file() else {}
    path.write_text(json.dumps({**content, str(image): entry}))
