"""Arguments of the commands that need no configuration, and what `hlp learn` makes of them."""

from pathlib import Path

import pytest
import trimesh
from hydra.errors import HydraException

from hlp.commands import arguments as own
from hlp.commands.learn import learning_request
from hlp.data.own_frames import FrameFiles
from hlp.errors import InputError
from hlp.method.settings import MethodSettings


def test_arguments_are_keys_and_values():
    given = own.split_arguments(["rgb=a=b.png", "data.photographs=p"])
    assert given == {"rgb": "a=b.png", "photographs": "p"}
    for wrong in ("rgb", "=a", "rgb="):
        with pytest.raises(ValueError, match="KEY=VALUE"):
            own.split_arguments([wrong])
    with pytest.raises(ValueError, match="given twice"):
        own.split_arguments(["a=1", "a=2"])


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e-3", 0.001), ("3", 3), (".9", 0.9), ("-9.e1", -90.0), (".hidden", ".hidden"),
     ("true", True), ("null", None), ("a,b (c).png", "a,b (c).png"),
     ("[1, 2.5]", [1, 2.5]), ("[a,b]", ["a", "b"]),
     ("'it is'", "it is"), ("a'b", "a'b")],
)  # fmt: skip
def test_values_are_read_as_they_look(text, value):
    assert own.plain_value(text) == value


def test_lists_of_files_are_separated_by_commas(tmp_path):
    odd = tmp_path / "a,b.ply"
    odd.touch()
    assert own.text_list(str(odd)) == [str(odd)]
    assert own.text_list("a.ply,b.obj") == ["a.ply", "b.obj"]
    assert own.text_list("[a.ply, b.obj]") == ["a.ply", "b.obj"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["predict", "lernt=x", "rgb=a.png"],
            "lernt is not a key of `hlp predict`: did you mean lea",
        ),
        (
            ["predict", "learnt=x", "rgb=a", "depht=b"],
            "depht is not a key of `hlp predict`: did you",
        ),
        (["predict", "learnt=x", "rgb=a", "depth_scale=1"], "depth is not set: give depth="),
        (["learn", "mehs=a.ply"], "mehs is not a key of `hlp learn`: did you mean mesh?"),
        (["learn", "names=a"], "mesh is not set: give mesh="),
        (["objects", "lst"], "cannot use 'lst': did you mean list? see `hlp objects --help`"),
        (["objects", "export", "a"], "cannot use 'export a': it must be hlp objects export NAME|"),
        (["report", "experimnt=demo"], "experimnt is not a key of `hlp report`: did you mean exp"),
        (
            ["notebooks", "folder=here"],
            "folder is not a key of `hlp notebooks`: see `hlp notebooks",
        ),
        (["clean", "dry=perhaps"], "dry=perhaps: it is true or false"),
        (["ui", "open=perhaps"], "open=perhaps: it is true or false"),
        (["ui", "port=here"], "port=here: it must be a whole number"),
        (["upload", "send"], "cannot use 'send': arguments have the form KEY=VALUE"),
        (["download", "output=x"], "'output=x': the name of a data set comes first"),
    ],
)
def test_a_mistyped_word_is_named_with_what_was_meant(words, said, fails):
    assert fails(*words).startswith(f"hlp: {said}")


@pytest.mark.parametrize("text", ["[" * 60_000, "[" * 900 + "x" + "]" * 900])
def test_a_value_of_brackets_is_no_list(text):
    with pytest.raises(InputError, match=r"more \[ than any value"):
        own.search_masks({"box": text})


def test_settings_are_read_from_their_own_keys():
    given = {"rgb": "a", "depth": "b", "intrinsics": "[1,2,3,4]", "depth_scale": "2", "x": "y"}
    files = own.read_group(FrameFiles, given)
    assert files == FrameFiles(rgb="a", depth="b", intrinsics=[1.0, 2.0, 3.0, 4.0], depth_scale=2.0)
    with pytest.raises(ValueError, match="depth_scale is 0"):
        own.read_group(FrameFiles, given | {"depth_scale": "0"})


@pytest.fixture
def meshes(tmp_path: Path) -> list[str]:
    paths = [tmp_path / f"{name}.ply" for name in "ab"]
    for path in paths:
        trimesh.creation.cylinder(0.03, 0.1).export(path)
    return [str(path) for path in paths]


def test_each_mesh_is_learnt_with_its_own_choices(meshes):
    given = {"symmetries": "none", "symmetries.b": "found", "holistic_size_mm.a": "80"}
    models = learning_request(given, meshes, ()).models
    assert [model.name for model in models.values()] == ["a", "b"]
    assert len(models[1].symmetries) == 1 < len(models[2].symmetries)
    assert models[1].holistic_size == 0.08 != models[2].holistic_size
    with pytest.raises(HydraException, match=r"colors\.c"):
        learning_request({"colors.c": "false"}, meshes, ())


def test_objects_are_learnt_with_the_method_s_settings_and_what_is_given(meshes):
    """In any pose: not with the settings of the demo."""
    settings = learning_request({}, meshes, ()).settings
    assert settings == MethodSettings()
    given = {"encoder": "pca", "rendering.viewpoints": "99"}
    settings = learning_request(given, meshes, ()).settings
    assert (settings.encoder.name, settings.rendering.viewpoints) == ("pca", 99)


@pytest.mark.parametrize("text", ["many", "-1", "1.5", "true", "99999", "[1]", "nan"])
def test_a_number_of_threads_is_no_word(text: str) -> None:
    with pytest.raises(InputError, match="it must be a whole number, 0 to 1024"):
        own.whole_number({"threads": text}, "threads")
    assert own.whole_number({"threads": "4"}, "threads") == 4
    assert own.whole_number({}, "threads") is None


def test_no_object_is_no_choice() -> None:
    assert own.names_of_objects({"objects": "a,b"}) == ["a", "b"]
    assert own.names_of_objects({}) is None
    with pytest.raises(InputError, match="objects names none"):
        own.names_of_objects({"objects": "[]"})


def test_exchanged_letters_are_near_and_other_words_are_not() -> None:
    assert own.nearest("rnu", ["report", "run"]) == ": did you mean run?"
    assert own.nearest("zebra", ["report", "run"]) == ""


def test_mlflows_own_variable_is_honoured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    assert own.tracking_uri("here") == "sqlite:///here/mlflow.db"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://server:5000")
    assert own.tracking_uri("here") == "http://server:5000"
