"""The command line: what is composed, run, said and returned; runs are stand-ins."""

import json
import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from omegaconf import DictConfig, OmegaConf

import hlp
from hlp.cli import main
from hlp.commands.composing import compose_config
from hlp.config import build
from hlp.errors import MissingFileError
from new_process import printed_by
from tiny_run import left_as_it_was

Said = pytest.CaptureFixture[str]


def stand_in(config: DictConfig, chosen: object = None) -> SimpleNamespace:
    """In place of `build_run`: a run that writes its configuration into its folder."""
    if config.seed == 13:
        raise MissingFileError("data.root: no folder /nowhere")
    if config.seed == 14:
        raise KeyError("a bug")

    def run(itself: object, output: Path) -> None:
        logging.getLogger("hlp.run").info("running %s", config.seed)
        (output / "seen.json").write_text(json.dumps(OmegaConf.to_container(config, resolve=True)))

    return SimpleNamespace(settings=SimpleNamespace(task=SimpleNamespace(run=run)))


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """An empty working folder; logging is as before afterwards: Hydra's handlers would stay."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["hlp"])
    monkeypatch.setattr(build, "build_run", stand_in)
    with left_as_it_was():
        yield tmp_path


def seen(folder: Path) -> Any:
    return json.loads((folder / "seen.json").read_text())


def test_the_package_is_the_command_line_too() -> None:
    code = (
        "import runpy, sys; sys.argv[1:] = ['--version']; runpy.run_module('hlp', None, '__main__')"
    )
    assert printed_by(code) == f"hlp {hlp.__version__}\n"


def test_a_bare_command_lists_the_commands_and_an_unknown_one_is_named(capsys: Said) -> None:
    main([])
    usage = capsys.readouterr().out
    assert "\n  run " in usage and "\n  report " in usage
    main(["--help"])
    assert capsys.readouterr().out == usage
    with pytest.raises(SystemExit) as ended:
        main(["rnu"])
    said = capsys.readouterr().err
    assert ended.value.code == 2 and usage.strip() in said and "Traceback" not in said
    assert said.startswith("hlp: there is no command 'rnu': did you mean run?\n")


def test_the_default_run_is_the_demo(folder: Path, capsys: Said) -> None:
    main(["run"])
    assert "running 0\n" in capsys.readouterr().out
    (output,) = (folder / "outputs" / "demo").iterdir()
    config = seen(output)
    assert (config["name"], config["output"]) == ("demo", str(output))
    assert config["data"]["name"] == "synthetic" and config["task"]["name"] == "evaluate"
    assert (output / ".hydra" / "config.yaml").is_file()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_log_that_cannot_be_written_is_silent(folder: Path, capsys: Said) -> None:
    main(["run", "hydra.job_logging.handlers.file.filename=/dev/full", "output=out"])
    assert "running 0\n" in capsys.readouterr().out and seen(folder / "out")
    (file,) = (each for each in logging.getLogger().handlers if each.get_name() == "file")
    with pytest.raises(OSError, match="No space left"):
        file.close()


def test_bench_is_a_task_of_its_own_on_the_same_data(folder: Path) -> None:
    main(["bench", "experiment=table1", "frames=3", "output=out"])
    config = seen(folder / "out")
    assert (config["task"]["name"], config["name"], config["frames"]) == ("bench", "table1", 3)


MINE = """\
# @package _global_
defaults:
  - override /method: paper
  - override /encoder: pca

name: mine
voting:
  hypotheses: 7
"""


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("method=paper encoder=pca refinement=icp", "sequential 5 kd_forest pca icp"),
        ("experiment=mine codebook=exact", "sequential 7 exact pca pso"),
        ("experiment=mine method=hlp voting.hypotheses=9", "joint 9 inverted_lists pca pso"),
    ],
)
def test_experiments_win_over_methods_and_the_command_line_over_both(
    given: str, expected: str, tmp_path: Path
) -> None:
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "mine.yaml").write_text(MINE)
    path = f"hydra.searchpath=[file://{tmp_path}]"
    config = compose_config(path, "output=out", *given.split())
    groups = (config.codebook, config.encoder, config.refinement)
    found = (config.voting.name, config.voting.hypotheses, *(group.name for group in groups))
    assert " ".join(map(str, found)) == expected


@pytest.mark.slow
@pytest.mark.thorough
def test_runs_of_a_sweep_have_folders_of_their_own_and_one_that_fails_stops_no_other(
    folder: Path, capsys: Said
) -> None:
    main(["-m", "refinement=pso,icp", "output=sweep"])
    names = [seen(folder / "sweep" / number)["refinement"]["name"] for number in "01"]
    assert names == ["pso", "icp"]
    with pytest.raises(SystemExit) as ended:
        main(["run", "-m", "seed=13,1", "output=other"])
    assert ended.value.code == 1
    assert "data.root: no folder /nowhere" in capsys.readouterr().out
    assert seen(folder / "other" / "1")["seed"] == 1


@pytest.mark.slow
@pytest.mark.thorough
def test_anytime_is_a_sweep_of_budgets(folder: Path) -> None:
    for number, (given, values) in enumerate(
        {"": [None, 5, 10, 20, 40], "refinement.budget_ms=5,7": [5, 7]}.items()
    ):
        main(["-m", "experiment=anytime", f"output=sweep{number}", *filter(None, [given])])
        found = [seen(path.parent) for path in folder.glob(f"sweep{number}/*/seen.json")]
        assert sorted(config["refinement"]["budget_ms"] for config in found) == values


def test_a_bug_keeps_its_traceback(folder: Path) -> None:
    with pytest.raises(KeyError, match="a bug"):
        main(["run", "seed=14"])


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("report experiment=demo", str(Path("outputs", "demo"))),
        ("report runs=[a]", "runs=[a]: name two"),
        ("bench compare=a.json", "name two bench.json"),
        ("bench compare=[a.json,b.json] frames=3", "leave frames=3 out"),
        ("bench compare=[a.json,b.json]", "a.json"),
    ],
)
def test_what_cannot_be_reported_or_compared_is_named(
    command: str, words: str, folder: Path, fails: Callable[..., str]
) -> None:
    said = fails(*command.split())
    assert said.startswith("hlp: ") and words in said
