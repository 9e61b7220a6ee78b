from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from frame_files import write_flat
from hlp.data.dataset import find_bad_frames
from hlp.data.frame_paths import with_frames
from hlp.data.own_frames import FrameFiles, OwnFrames
from hlp.data.ycbineoat import YcbineoatFrames, YcbineoatSettings
from hlp.errors import DataError, MissingFileError

K = np.array([[319.6, 0, 20.0], [0, 417.1, 15.0], [0, 0, 1]])
STAMPS = ("1581120424100262102", "1581120424148532296", "1581120424200000000")


def pose(number):
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec([0.1 * number, 0.2, 0.3]).as_matrix()
    motion[:3, 3] = [0.01, 0.02, 0.5 + 0.1 * number]
    return motion


@pytest.fixture
def root(tmp_path):
    """Images named by time, poses by number, as in the published sequences; a mesh beside them."""
    (tmp_path / "annotated_poses").mkdir()
    for number, stamp in enumerate(STAMPS):
        write_flat(tmp_path, f"{stamp}.png", (100 + number, 0, 0), 600 + number)
        np.savetxt(tmp_path / "annotated_poses" / f"{number:07d}.txt", pose(number))
    np.savetxt(tmp_path / "cam_K.txt", K)
    trimesh.creation.box((0.05, 0.1, 0.2)).export(tmp_path / "box.ply")
    return tmp_path


def test_frames_have_the_poses_of_their_order(root):
    frames = YcbineoatFrames(root)
    assert frames.keys == ("000000_000000", "000000_000001", "000000_000002")
    for number, key in enumerate(frames.keys):
        frame = frames.load(key)
        assert tuple(frame.rgb[0, 0]) == (100 + number, 0, 0)
        np.testing.assert_allclose(frame.depth, 0.6 + number / 1000, rtol=1e-6)
        np.testing.assert_allclose(frame.camera_matrix, K)
        (target,) = frame.targets
        np.testing.assert_allclose(target.pose_cam_obj, pose(number), atol=1e-12)


def test_poses_of_the_images_names_belong_to_them(root):
    for number, stamp in enumerate(STAMPS[1:]):
        path = root / "annotated_poses" / f"{number:07d}.txt"
        path.rename(path.with_stem(stamp))
    frames = YcbineoatFrames(root)
    assert len(frames.keys) == 2  # no frame of an image without a pose, or a pose without an image
    frame = frames.load(frames.keys[0])
    assert frame.rgb[0, 0, 0] == 101
    np.testing.assert_allclose(frame.targets[0].pose_cam_obj, pose(0), atol=1e-12)


def test_the_data_set_is_built_from_a_mesh_and_the_folder(root):
    dataset = YcbineoatSettings(root=str(root), mesh=str(root / "box.ply")).build()
    (model,) = dataset.models.values()
    assert (model.name, dataset.target_ids) == ("box", (1,))
    assert model.diameter == pytest.approx(np.linalg.norm((0.05, 0.1, 0.2)))
    before = dataset.frames.identity()
    np.savetxt(root / "annotated_poses" / "0000001.txt", pose(7))
    assert YcbineoatFrames(root).identity() != before
    with pytest.raises(MissingFileError, match=r"data\.mesh is not a file"):
        YcbineoatSettings(root=str(root), mesh="none.ply").build()


def test_predicting_needs_only_the_folder(root):
    frames = OwnFrames(FrameFiles(**with_frames({"frames": str(root)})))
    frame = frames.load(frames.keys[1])
    np.testing.assert_allclose(frame.camera_matrix, K)
    np.testing.assert_allclose(frame.depth, 0.601, rtol=1e-6)


def at(depth):
    motion = pose(1)
    motion[2, 3] = depth
    return motion


def rewritten(path, content):
    return lambda root: (root / path).write_text(content)


def posed(matrix):
    return lambda root: np.savetxt(root / "annotated_poses/0000001.txt", matrix)


DEPTH = f"depth/{STAMPS[1]}.png"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (rewritten(DEPTH, "?"), "is truncated or no image"),
        (rewritten("annotated_poses/0000001.txt", "x y"), "0000001.txt"),
        (posed(np.full((4, 4), np.nan)), "must hold 16 finite numbers"),
        (posed(pose(1).T), "is not a pose: it must be R t / 0 0 0 1"),
        (posed(at(0.001)), "to 100 m before it: translations are in metres"),
    ],
)
def test_a_bad_frame_costs_itself_alone(root, spoil, words):
    dataset = YcbineoatSettings(root=str(root), mesh=str(root / "box.ply")).build()
    keys, identity = dataset.frames.keys, dataset.frames.identity()
    assert find_bad_frames(dataset, keys) == {}
    spoil(root)
    fresh = replace(dataset, frames=YcbineoatFrames(root))
    assert fresh.frames.keys == keys
    found = find_bad_frames(fresh, keys)
    assert [*found] == [keys[1]]
    assert words in found[keys[1]]
    assert [object_id for object_id, _ in fresh.frames.stated_targets(keys[1])] == [1]
    assert fresh.frames.identity() != identity


def test_a_wrong_camera_or_unit_is_said_of_all_frames(root):
    settings = YcbineoatSettings(root=str(root), mesh=str(root / "box.ply"), depth_scale=1000.0)
    dataset = settings.build()
    found = find_bad_frames(dataset, dataset.frames.keys)
    assert len(found) == 3 and all("are these metres" in reason for reason in found.values())
    np.savetxt(root / "cam_K.txt", K * [[4, 1, 4], [1, 4, 4], [1, 1, 1]])
    found = find_bad_frames(dataset, dataset.frames.keys)
    assert len(found) == 3 and all(
        "cam_K.txt: the principal" in reason for reason in found.values()
    )


def test_missing_parts_are_named(root):
    (root / "annotated_poses" / "0000002.txt").unlink()
    with pytest.raises(DataError, match="has 3 images and 2 poses"):
        _ = YcbineoatFrames(root).keys
    (root / "depth" / f"{STAMPS[0]}.png").unlink()
    (root / "annotated_poses" / "0000002.txt").write_text("x y")
    with pytest.raises(MissingFileError, match=STAMPS[0]):
        YcbineoatFrames(root).load("000000_000000")
    for path in (root / "rgb").iterdir():
        path.unlink()
    with pytest.raises(MissingFileError, match="no image in"):
        _ = YcbineoatFrames(root).keys
