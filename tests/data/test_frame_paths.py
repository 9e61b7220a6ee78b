import pytest

from hlp.data.frame_paths import list_images, pair_frames


def no_video(path):
    raise AssertionError(f"{path} is no video")


def make(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.touch()


def pairs(folder, rgb, depth, count=no_video):
    found = pair_frames(str(folder / rgb), str(folder / depth), count)
    return [(each.color.name, each.depth.name) for each in found]


def test_two_files_are_one_frame_whatever_their_names(tmp_path):
    make(tmp_path, "a.jpg", "b.npy")
    assert pairs(tmp_path, "a.jpg", "b.npy") == [("a.jpg", "b.npy")]


def test_patterns_are_paired_by_number_in_natural_order(tmp_path):
    make(tmp_path, *(f"{kind}_{i}.png" for kind in ("color", "depth") for i in (10, 2, 1)))
    expected = [(f"color_{i}.png", f"depth_{i}.png") for i in (1, 2, 10)]
    assert pairs(tmp_path, "color_*.png", "depth_*.png") == expected


def test_folders_are_paired_by_name_or_else_by_number(tmp_path):
    make(tmp_path, "rgb/x1.jpg", "rgb/x2.jpg", "depth/x1.exr", "depth/x2.png", "depth/x3.npy")
    assert pairs(tmp_path, "rgb", "depth") == [("x1.jpg", "x1.exr"), ("x2.jpg", "x2.png")]
    make(tmp_path, "color/color_07.png", "d16/depth-7.tiff", "color/notes.txt", "color/.x.png")
    assert pairs(tmp_path, "color", "d16") == [("color_07.png", "depth-7.tiff")]


def test_an_image_finds_its_depth_in_a_folder(tmp_path):
    make(tmp_path, "a.png", "depth/a.npy", "depth/b.npy")
    assert pairs(tmp_path, "a.png", "depth") == [("a.png", "a.npy")]


def test_the_frames_of_a_video_meet_the_sorted_depth_images(tmp_path):
    make(tmp_path, "v.mp4", *(f"depth/{i}.png" for i in (9, 10, 11)))
    found = pair_frames(str(tmp_path / "v.mp4"), str(tmp_path / "depth"), lambda _: 3)
    assert [(each.name, each.depth.name) for each in found] == [
        ("v_000000", "9.png"), ("v_000001", "10.png"), ("v_000002", "11.png"),
    ]  # fmt: skip
    with pytest.raises(ValueError, match=r"has 4 frames, depth, .*, has 3 images"):
        pairs(tmp_path, "v.mp4", "depth", lambda _: 4)


def test_what_has_no_partner_is_named(tmp_path):
    make(tmp_path, "rgb/a.png", "rgb/b.png", "depth/a.png", "c/x.png", "c/y.png")
    with pytest.raises(FileNotFoundError, match=r"depth: .* no b\.png"):
        pairs(tmp_path, "rgb", "depth")
    with pytest.raises(ValueError, match="depth is one image and rgb has 2"):
        pairs(tmp_path, "rgb", "depth/a.png")
    with pytest.raises(ValueError, match="cannot be paired"):
        pairs(tmp_path, "c", "depth")
    make(tmp_path, "r2/f_1.png", "r2/f_2.png", "d2/g_1.png")
    with pytest.raises(FileNotFoundError, match="no number 2 for"):
        pairs(tmp_path, "r2", "d2")
    make(tmp_path, "rgb/a.jpg")
    with pytest.raises(ValueError, match="one name"):
        pairs(tmp_path, "rgb", "depth")


def test_what_is_not_there_is_named(tmp_path):
    (tmp_path / "empty").mkdir()
    for given, words in (
        ("none.png", "rgb is no image"), ("empty", "no image in"), ("c_*.png", "no file is like"),
    ):  # fmt: skip
        with pytest.raises(FileNotFoundError, match=f"rgb.*{words}|{words}"):
            list_images(str(tmp_path / given), "rgb", (".png",))


def test_a_file_whose_name_has_a_bracket_is_a_file(tmp_path):
    make(tmp_path, "a[1].png")
    assert list_images(str(tmp_path / "a[1].png"), "rgb", (".png",)) == [tmp_path / "a[1].png"]
