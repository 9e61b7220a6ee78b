import json
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from bop_folder import write_models
from composed_settings import run_settings
from frame_files import write_flat
from hlp.arrays import spread
from hlp.commands.composing import compose_config
from hlp.config import build
from hlp.config.build import build_run, check_symmetric
from hlp.config.composition import group_kinds, rows
from hlp.config.settings import RunSettings
from hlp.data.bop import BopSettings
from hlp.errors import DataError, MissingDependencyError
from hlp.evaluation import EvaluationSettings

CONF = Path(__file__).parents[2] / "conf"


@pytest.fixture(scope="module")
def default():
    """The default configuration; it is copied, never changed: composing takes half a second."""
    return compose_config("output=out")


def changed(config, key, value):
    copy = OmegaConf.create(OmegaConf.to_container(config, resolve=True))
    OmegaConf.set_struct(copy, False)
    OmegaConf.update(copy, key, value)
    return copy


def alternatives(group):
    return sorted({*rows().get(group, {}), *(path.stem for path in (CONF / group).glob("*.yaml"))})


def rounds():
    """Every alternative of every group once, in as few compositions as may be: they are slow."""
    names = [group for group in group_kinds() if alternatives(group) and group != "data"]
    groups = {group: alternatives(group) for group in names}
    for i in range(max(len(names) for names in groups.values())):
        yield {group: names[i % len(names)] for group, names in groups.items()}


@pytest.mark.parametrize("chosen", list(rounds()))
def test_every_alternative_becomes_typed_settings(chosen):
    given = [f"{key}={name}" for key, name in chosen.items()]
    if chosen["executor"] == "dask":
        given.append("executor.address=tcp://host:8786")  # which only its user knows
    settings = run_settings(*given)
    for group, name in chosen.items():
        file = CONF / group / f"{name}.yaml"
        stated = OmegaConf.load(file).get("name") if file.is_file() else name
        assert getattr(settings, group).name == stated


@pytest.mark.parametrize("method", alternatives("method"))
def test_methods_become_typed_settings(method):
    assert isinstance(run_settings(f"method={method}"), RunSettings)


def test_the_default_run_is_the_demo_and_needs_no_files(default):
    run = build_run(default)
    assert run.settings.name == "demo"
    assert len(run.keys) == run.settings.data.scenes
    assert run.dataset.target_ids == tuple(run.dataset.models)
    assert run.config["seed"] == 0 and "rendering" in run.config
    json.dumps(run.config)  # plain values


@pytest.mark.parametrize(("key", "value"), [("data.noise", 0.5), ("data.clutter", [1, 2])])
def test_what_the_test_scenes_look_like_is_no_reason_to_train_again(default, key, value):
    plain, other = build_run(default).dataset, build_run(changed(default, key, value)).dataset
    assert other.frames_identity != plain.frames_identity
    for name in ("background_frames", "encoder_frames"):
        assert getattr(other, name).identity() == getattr(plain, name).identity()


WRONG = [
    ("seed", "abc", r"^seed is 'abc': it must be a whole number$"),
    ("rendering.viewpoints", 3.5, r"^rendering\.viewpoints is 3\.5: it must be a whole number$"),
    ("rendering.viewpoint", 9, r"^rendering\.viewpoint is not a key: did you mean viewpoints\?$"),
    ("patches.holistic.resolution", 48, r"^patches\.holistic\.resolution is 48: .* 64$"),
    ("refinement.phi_1", 1.0, r"^refinement\.phi_1 \+ phi_2 is 2\.3: it must be above 4$"),
    ("encoder.input", "depth", r"^encoder\.input .*'rgbd' or 'normals_depth'$"),
    ("encoder.name", "cea", r"^encoder\.name is 'cea': choose one of cae, contrastive, pca$"),
    ("task.name", "orakel", r"^task\.name is 'orakel': choose one of basin, bench, evaluate, "),
    ("task.frame", 3, r"^task\.frame is not a key: "),
    ("classifier.widths", [8] * 7, r"^classifier\.widths is .*1 to 6"),
    ("frames", 0, r"^frames is 0: it must be at least 1$"),
    ("data.objects", [4, 9], r"^data\.objects\.1 is 9: it must be at most 8$"),
    ("data.objects", [6, 5], r"^data\.objects is \[6, 5\]: it must be \[least, most\]$"),
    ("mesh", "a.ply", r"^mesh is not a key: there are seed, rendering, "),
    ("output", "", r"^output is empty: name one$"),
    ("name", "???", r"^name is not set: set name=VALUE$"),
    ("data.seed", "???", r"^data\.seed is not set: set data\.seed=VALUE$"),
]


@pytest.mark.parametrize(("key", "value", "message"), WRONG)
def test_a_wrong_value_is_named_by_its_key(default, key, value, message):
    with pytest.raises(ValueError, match=message) as caught:
        build_run(changed(default, key, value))
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 200


@pytest.fixture
def bop(tmp_path):
    """A BOP data set of one box in one frame, and its configuration. It has no images."""
    scene = tmp_path / "lm" / "test" / "000003"
    scene.mkdir(parents=True)
    pose = {"cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [0, 0, 800.0], "obj_id": 1}
    (scene / "scene_gt.json").write_text(json.dumps({"5": [pose]}))
    camera = {"cam_K": [500, 0, 320, 0, 500, 240, 0, 0, 1], "depth_scale": 1.0}
    (scene / "scene_camera.json").write_text(json.dumps({"5": camera}))
    write_models(tmp_path / "lm" / "models", [1])
    return tmp_path / "lm"


@pytest.fixture(scope="module")
def board():
    return compose_config("output=out", "experiment=linemod_bop", "data.root=???")


@pytest.fixture
def bop_config(board, bop):
    """Makes the configuration of the box, with some of data's keys changed."""
    return lambda **data: _bop_config(board, data.pop("root", bop), data)


def _bop_config(board, root, data):
    config = board.copy()
    box = {"id": 1, "holistic_size_mm": 120.0, "local_size_mm": None}
    nothing = dict.fromkeys(("targets", "photographs", "rooms", "rgbd_frames"))
    given = {"root": str(root), "objects": {"box": box}, "proxy_faces": 24, **nothing, **data}
    for key, value in given.items():
        config.data[key] = value
    return config


def test_a_data_set_is_built_without_decoding_an_image(bop_config, monkeypatch):
    monkeypatch.setattr(build, "find_bad_frames", lambda *_: {})  # the frame has no image
    run = build_run(bop_config())
    assert isinstance(run.settings.data, BopSettings)
    assert run.keys == ("000003_000005",)
    assert run.dataset.target_ids == (1,)
    model = run.dataset.models[1]
    assert (model.name, model.holistic_size) == ("box", 0.12)
    assert model.diameter == pytest.approx(np.linalg.norm([0.08, 0.09, 0.1]))


def test_bad_frames_are_known_when_the_run_is_built(bop_config):
    with pytest.raises(DataError, match=r"none of the 1 frames can be used.*no image"):
        build_run(bop_config())
    config = bop_config()
    config.on_bad_frame = "fail"
    with pytest.raises(DataError, match=r"^frame 000003_000005: no image"):
        build_run(config)


@pytest.mark.parametrize("names", [["teapot"], ["box", "teapot"]])
def test_a_symmetric_object_that_no_data_set_has_is_an_error(names):
    with pytest.raises(ValueError, match=r"evaluation\.symmetric names teapot.*objects: box"):
        check_symmetric(EvaluationSettings(symmetric=tuple(names)), ["box"])


def test_names_of_another_set_that_match_nothing_are_said(caplog):
    check_symmetric(EvaluationSettings(symmetric=("bowl", "cup")), ["bowl", "cat"])
    check_symmetric(EvaluationSettings(), ["box"])
    assert not caplog.records
    check_symmetric(EvaluationSettings(symmetric=("bowl", "cup")), ["obj_000003", "obj_000006"])
    (record,) = caplog.records
    assert "no object is called bowl or cup" in record.message
    assert "evaluation=bop_numbers" in record.message


@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        ({"root": "???"}, ValueError, r"^data\.root is not set: set data\.root=VALUE$"),
        ({"root": "nowhere"}, FileNotFoundError, r"^data\.root is not a folder: nowhere"),
        ({"split": "train"}, FileNotFoundError, r"/lm has no folder train: set data\.split=NAME"),
        *(
            ({key: folder}, FileNotFoundError, message)
            for key in ("photographs", "rooms", "rgbd_frames")
            for folder, message in (
                ("nowhere", rf"^data\.{key} is not a folder: .*nowhere"),
                ("empty", "empty"),
            )
        ),
    ],
)
def test_what_is_missing_of_a_data_set_is_named_before_any_stage(
    bop_config, data, error, message, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(error, match=message):
        build_run(bop_config(**data))


@pytest.mark.parametrize(
    ("name", "content", "error", "message"),
    [
        (
            "models/obj_000001.ply",
            "",
            FileNotFoundError,
            r"object 1 \(box\).*models/obj_000001\.ply",
        ),
        ("models/obj_000001.ply", "ply\nnonsense", ValueError, r"obj_000001\.ply"),
        ("test/000003/scene_gt.json", "{}", ValueError, "lists no target"),
    ],
)
def test_a_file_of_a_data_set_that_is_damaged_or_not_there_is_named(
    bop, bop_config, name, content, error, message
):
    (bop / name).unlink()
    if content:
        (bop / name).write_text(content)
    with pytest.raises(error, match=message):
        build_run(bop_config())


def test_data_without_a_frame_are_refused(default):
    with pytest.raises(ValueError, match=r"^data holds no frame with a target$"):
        build_run(changed(default, "data.scenes", 0))


def test_the_autoencoder_asks_for_frames_before_any_stage(bop_config, tmp_path, monkeypatch):
    monkeypatch.setattr(build, "find_bad_frames", lambda *_: {})
    config = bop_config()
    config.encoder = {"name": "cae"}
    with pytest.raises(ValueError, match=r"^encoder=cae .* set data\.rgbd_frames to a folder$"):
        build_run(config)
    frames = tmp_path / "frames"
    write_flat(frames, "000001.png", 0, 0, (8, 8))
    (frames / "camera.json").touch()
    config.data.rgbd_frames = str(frames)
    assert build_run(config).dataset.encoder_frames is not None


@pytest.mark.parametrize("count", [1, 2, 5, 7, 99, None])
def test_frames_are_spread_evenly(default, count):
    chosen = spread(range(7), count)
    assert len(chosen) == min(count or 7, 7) and chosen[0] == 0
    steps = np.diff(chosen)
    assert len(steps) == 0 or steps.max() - steps.min() <= 1


def test_a_run_may_be_of_some_frames(default):
    assert build_run(changed(default, "frames", 3)).keys == spread(build_run(default).keys, 3)


def test_a_gpu_that_is_not_there_is_named(default, monkeypatch):
    monkeypatch.setattr("onnxruntime.get_available_providers", lambda: ["CPUExecutionProvider"])
    with pytest.raises(MissingDependencyError, match=r"machine\.device is cuda.*onnxruntime-gpu"):
        build_run(changed(default, "machine.device", "cuda"))
