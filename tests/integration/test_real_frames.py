"""The method on a handful of real LINEMOD frames, trained on the CAD models in a minute or two."""

import json
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from hlp.commands.composing import config_folder
from tiny_run import start_run

SMALL = (
    "experiment=linemod_bop",
    "encoder=pca",
    "rendering.viewpoints=200",
    "rendering.in_plane_steps=7",
    "patches.pool.per_object=1500",
    "patches.pool.backgrounds=3000",
    "patches.pairs.per_object=1000",
    "classifier.epochs=8",
    "panels=1",
)


@pytest.mark.slow
def test_cat_and_driller_are_found_in_real_frames(shared_data: Path, tmp_path: Path) -> None:
    root = tmp_path / "lm"
    root.mkdir()
    for name in ("models", "test"):
        (root / name).symlink_to(shared_data / "lm" / name)
    images = sorted(int(path.stem) for path in (root / "test" / "000006" / "rgb").iterdir())
    drillers = sorted(int(path.stem) for path in (root / "test" / "000008" / "rgb").iterdir())
    wanted = [(6, image, 6) for image in images[:: len(images) // 6][:6]]
    wanted += [(8, image, 8) for image in drillers[:3]]
    keys = ("scene_id", "im_id", "obj_id")
    rows = [{**dict(zip(keys, each, strict=True)), "inst_count": 1} for each in wanted]
    (root / "few.json").write_text(json.dumps(rows))
    names = OmegaConf.load(config_folder() / "data" / "objects" / "linemod.yaml")
    done = start_run(
        tmp_path,
        *SMALL,
        *(f"~data.objects.{name}" for name in names if name not in {"cat", "driller"}),
        f"data.root={root}",
        "data.targets=few.json",
        f"data.photographs={shared_data / 'photos'}",
        f"data.rooms={shared_data / 'rooms'}",
        "data.rgbd_frames=null",
        "output=real",
        threads=2,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "real" / "summary.json").read_text())
    assert summary["targets"] == len(wanted)
    assert summary["per_object"].keys() == {"cat", "driller"}
    assert summary["metrics"]["iou50"]["recall"] >= 0.7
    assert summary["metrics"]["add"]["recall"] >= 0.6
