"""Hydra's options among the overrides, and its errors in our words."""

import logging
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from hlp.cli import main
from hlp.commands.composing import LogFile, compose_config, hydra_in_words
from new_process import run_python

Out = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    "given",
    [
        ["run", "seed=7", "--cfg", "job", "-p", "seed"],
        ["bench", "--cfg", "job", "-p", "seed", "seed=7"],
        ["search", "refinement=icp", "-c", "job", "seed=7", "--package", "seed", "frames=3"],
    ],
)
def test_options_stand_where_one_likes(
    given: list[str], capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["hlp"])
    main(given)
    assert yaml.safe_load(capsys.readouterr().out) == 7


def test_a_run_that_never_began_leaves_no_folder(tmp_path: Path) -> None:
    for wrong in ("frames=${absent}", "machine.device=absent"):
        done = run_python(f"from hlp.cli import main; main(['run', '{wrong}'])", tmp_path)
        assert done.stderr.startswith("hlp: ") and done.stderr.count("\n") == 1
    assert not [*tmp_path.glob("outputs/*/*")]


def test_options_that_exclude_each_other_are_named(fails) -> None:
    said = "hlp: --info and --multirun exclude each other: leave one out"
    assert fails("run", "--info", "config", "seed=1", "--multirun") == said


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("refinement.particels=3", "Could not override 'refinement.particels': did you mean refin"),
        ("refinment=icp", "Could not override 'refinment': did you mean refinement?"),
        (
            "refinement=icpp",
            "Could not find 'refinement/icpp' Available options in 'refinement': ic",
        ),
        (
            "hydra/launcher=core",
            "In 'hydra/config': Could not find 'hydra/launcher/core' Available",
        ),
        (
            "refinement=icp refinement.particles=8",
            "Could not override 'refinement.particles': the chosen refinement has no such key",
        ),
        ("foo", "cannot read 'foo' (Error parsing override 'foo'): settings are given as KEY=VA"),
        ("a=[1", "cannot read 'a=[1' (no viable alternative at input '[1'): settings are given"),
        ("seed=1,2", "Ambiguous value for argument 'seed=1,2' 1. To use it as a list, use key=[v"),
    ],
)
def test_errors_of_overrides_are_one_line_with_what_was_meant(override: str, words: str) -> None:
    with pytest.raises(HydraException) as caught:
        compose_config(*override.split())
    said = hydra_in_words(caught.value)
    assert said.startswith(words)
    assert "\n" not in said


def test_a_launcher_without_its_plugin_says_what_to_install(tmp_path: Path) -> None:
    extras = {"cores": "joblib", "slurm": "slurm", "submitit_local": "slurm"}
    code = (
        "import sys\n"
        "sys.modules['hydra_plugins'] = None\n"  # importing it raises ImportError
        "from hlp.cli import main\n"
        f"for launcher in {[*extras]}:\n"
        "    try: main(['-m', f'hydra/launcher={launcher}', 'seed=0,1'])\n"
        "    except SystemExit as ended: assert ended.code == 1\n"
    )
    assert run_python(code, tmp_path).stderr.splitlines() == [
        f"hlp: this launcher needs the extra '{extra}': pip install 'hlp[{extra}]'"
        for extra in extras.values()
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("defaults: [pso\nparticles: 3\n", "mine.yaml, line 2 is not YAML: expected ',' or ']'"),
        ("\tparticles: 3\n", "mine.yaml, line 1 is not YAML: found character '\\t'"),
        ("defaults: [psso]\n", "In 'refinement/mine': Could not load 'refinement/psso'"),
        (
            "# @package _global_\ndefaults: [override /voting: joint, override /codebok: exact]\n",
            "In 'refinement/mine': Could not override 'codebok'. No match in the defaults list",
        ),
    ],
)
def test_faults_in_a_file_of_ones_own_name_it(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "refinement").mkdir()
    (tmp_path / "refinement" / "mine.yaml").write_text(text)
    with pytest.raises((HydraException, YAMLError)) as caught:
        compose_config(f"hydra.searchpath=[file://{tmp_path}]", "refinement=mine")
    said = hydra_in_words(caught.value)
    assert words in said
    assert "\n" not in said


def test_a_broken_file_ends_the_command_in_one_line(tmp_path, monkeypatch, fails) -> None:
    (tmp_path / "refinement").mkdir()
    (tmp_path / "refinement" / "mine.yaml").write_text("particles: [1\n")
    monkeypatch.setattr("sys.argv", ["hlp"])
    line = fails("run", "--config-dir", str(tmp_path), "refinement=mine")
    assert line.startswith(f"hlp: {tmp_path}/refinement/mine.yaml, line 2 is not YAML")


def test_a_reference_to_nothing_is_one_line_with_its_key() -> None:
    with pytest.raises(OmegaConfBaseException) as caught:
        _ = OmegaConf.create({"name": "${nothing}"}).name
    assert hydra_in_words(caught.value) == "name: Interpolation key 'nothing' not found"


def test_other_errors_stay_as_they_are() -> None:
    assert hydra_in_words(ValueError("something\nelse")) == "something\nelse"


@pytest.fixture
def logger():
    logger = logging.Logger("of this test")
    yield logger
    for handler in logger.handlers:
        with suppress(OSError):  # what could not be written cannot be written now
            handler.close()


def test_a_full_disk_hides_nothing_else(logger, capsys):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    logger.addHandler(LogFile("/dev/full"))
    logger.warning("cannot be written")
    assert capsys.readouterr().err == ""


def test_a_message_with_a_bug_shows_where_it_is(logger, tmp_path, capsys):
    logger.addHandler(LogFile(tmp_path / "log"))
    logger.warning("%d poses", "three")
    assert "Traceback" in capsys.readouterr().err
    logger.warning("%d poses", 3)
    assert (tmp_path / "log").read_text() == "3 poses\n"
