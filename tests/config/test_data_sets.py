import pytest
from omegaconf import OmegaConf

from composed_settings import run_settings
from hlp.commands.composing import compose_config
from hlp.rendering.views import ViewsSettings
from hlp.settings import read_settings


def test_the_board_becomes_typed_settings():
    settings = run_settings("data=linemod_bop", "data.root=lm").data
    assert settings.name == "bop"
    assert settings.photographs == "lm/../photos"
    assert len(settings.objects) == 15
    assert settings.objects["ape"].id == 1
    assert settings.objects["driller"].holistic_size_mm == 200.0
    assert settings.symmetry_steps > 72  # coarser steps alone would cost more than 2.5 degrees


def test_an_objects_size_can_be_swept_and_an_object_left_out():
    overrides = ["data.root=lm", "data.objects.cat.local_size_mm=60", "~data.objects.ape"]
    settings = run_settings("data=linemod_bop", *overrides).data
    assert settings.objects["cat"].local_size_mm == 60.0
    assert "ape" not in settings.objects
    overrides = ["data.root=lm", "data.only=[can,ape]"]
    assert run_settings("data=linemod_bop", *overrides).data.only == ("can", "ape")


def _choices(*overrides):
    config = run_settings(*overrides, "data.root=lm")
    return config.evaluation.name, config.rendering.coverage, config.rendering.in_plane_max_deg


@pytest.mark.parametrize("data", ["linemod_bop", "linemod"])
def test_linemod_has_its_range_of_poses_and_its_symmetric_objects(data):
    assert _choices(f"data={data}") == ("bop", "hemisphere", 45.0)
    chosen = ("evaluation=eggbox_glue", "rendering.coverage=sphere")
    assert _choices(f"data={data}", *chosen)[:2] == ("eggbox_glue", "sphere")


def test_any_bop_set_has_the_default_range_and_the_symmetries_of_its_models():
    run = run_settings("data=bop", "data.root=lm")
    settings = run.data
    assert (settings.split, settings.targets, dict(settings.objects)) == ("auto", "auto", {})
    assert run.evaluation.symmetric is None
    assert run.rendering == ViewsSettings()


def test_the_recordings_differ_by_folder_and_range_of_poses_alone():
    def composed(data):
        config = compose_config("experiment=recordings", f"data={data}", "data_folder=there")
        return OmegaConf.to_container(config, resolve=False)

    names = ("cup", "mustard", "ycbv", "parts", "boxes")
    board, *others = (composed(name) for name in ("board", *names))
    folders = [config["data"].pop("root") for config in (board, *others)]
    assert folders == [f"${{data_folder}}/{name}" for name in ("lm", *names)]
    assert {config["data"]["empty"] for config in (board, *others)} == {"${data_folder}/tables"}
    for config in others:
        assert read_settings(ViewsSettings, config.pop("rendering")) == ViewsSettings()
    assert board.pop("rendering")["coverage"] == "hemisphere"
    # What counts as right on LINEMOD's board is its literature's.
    assert board.pop("evaluation")["symmetric"] == [f"obj_{i:06d}" for i in (3, 7, 10, 11)]
    assert [config.pop("evaluation")["symmetric"] for config in others] == [None] * 5
    assert all(config == board for config in others)
