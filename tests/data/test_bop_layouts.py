"""BOP's seven core sets, each in its own layout, are read as they are."""

import numpy as np
import pytest

from bop_sets import LAYOUTS, write_bop_set
from hlp.data.bop import BopSettings
from hlp.errors import DataError, MissingFileError


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_set_is_read_in_its_own_layout(name, tmp_path):
    root = tmp_path / name
    layout = write_bop_set(name, root)
    private = not next(iter(layout.splits.values()))
    data = BopSettings(root=str(root), split="test").build()
    frames = [data.frames.load(key) for key in data.frames.keys[:-1]]
    assert len(data.frames.keys) == 3 and len(data.models) == 2
    with pytest.raises(DataError, match="no depth at any pixel"):
        data.frames.load(data.frames.keys[-1])
    colored = next(iter(layout.models.values())) is not None and not layout.bin  # parts are grey
    assert {model.mesh.colored for model in data.models.values()} == {colored}
    assert set(data.evaluation_meshes) == set(data.models)
    assert len({tuple(frame.camera_matrix[:2, 2]) for frame in frames}) == 2
    assert all(0.4 < np.median(frame.depth[frame.depth > 0]) < 1.3 for frame in frames)
    for frame in frames:
        assert (frame.rgb == frame.rgb[..., :1]).all() == layout.color.startswith("gray")
        assert bool(frame.targets) != private
    counts = [n for frame in frames for n in data.instances_to_find(frame).values()]
    assert (max(counts) > 1) == layout.bin
    assert data.vsd_delta == (0.005 if name == "itodd" else 0.015)
    if private:
        assert BopSettings(root=str(root)).build().frames.load(data.frames.keys[1]).targets


def test_detection_looks_for_all_objects_in_all_images(tmp_path):
    write_bop_set("lmo", tmp_path)
    listed = tmp_path / "test_targets_bop19.json"
    listed.write_text('[{"scene_id": 1, "im_id": 1, "obj_id": 2, "inst_count": 1}]')
    known = BopSettings(root=str(tmp_path)).build()
    assert len(known.frames.keys) == 1 and known.target_ids == (2,)
    data = BopSettings(root=str(tmp_path), search="all").build()
    assert len(data.frames.keys) == 3 and data.target_ids == tuple(data.models) and data.search_all
    frame = data.frames.load(data.frames.keys[0])
    assert set(data.instances_to_find(frame)) == set(data.models)


def test_a_scene_that_lacks_its_true_poses_is_named_where_others_have_them(tmp_path):
    write_bop_set("tless", tmp_path)
    (tmp_path / "test_primesense" / "000002" / "scene_gt.json").unlink()
    frames = BopSettings(root=str(tmp_path)).build().frames
    assert frames.load("000001_000000").targets
    with pytest.raises(MissingFileError, match=r"000002/scene_gt\.json"):
        frames.load("000002_000000")
