"""The command line; runs in processes of their own, with stand-ins for all groups and the run."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import hlp
from hlp.cli import main
from hlp.files import config_folder
from hlp.records import TargetScore
from hlp.results.poses_file import write_scores

STAND_INS = {
    "data": ("demo", "linemod_bop"),
    "rendering": ("auto",),
    "patches": ("hlp", "paper"),
    "classifier": ("cnn",),
    "encoder": ("contrastive", "cae", "cae_cycle", "cae_varied", "pca"),
    "codebook": ("inverted_lists", "exact", "joint_lists", "kd_forest"),
    "voting": ("joint", "paper", "sequential"),
    "refinement": ("pso", "icp", "paper"),
    "evaluation": ("symmetries",),
    "machine": ("local", "cuda"),
    "score": ("rendered",),
    "executor": ("serial", "loky"),
    "trainer": ("cpu", "gpu"),
    "task": ("evaluate", "oracle", "basin", "bench", "search"),
}

DRIVER = """
import json, logging, sys, types
from pathlib import Path
import hlp.cli, hlp.config, hlp.files

def build_run(config, chosen=None):
    from omegaconf import OmegaConf
    from hlp.errors import MissingFileError
    if config.seed == 13:
        raise MissingFileError("data.root: no folder /nowhere")
    if config.seed == 14:
        raise KeyError("a bug")
    config = OmegaConf.to_container(config, resolve=True)
    task = types.SimpleNamespace(run=lambda run, output: run_task(config, output))
    return types.SimpleNamespace(settings=types.SimpleNamespace(task=task))

def run_task(config, output):
    logging.getLogger("hlp.run").info("running %s", config["seed"])
    (output / "seen.json").write_text(json.dumps(config))

hlp.config.build = types.ModuleType("hlp.config.build")
hlp.config.build.build_run = build_run
sys.modules["hlp.config.build"] = hlp.config.build
hlp.files.config_folder = lambda: Path("conf").absolute()
hlp.cli.main()
"""

Hlp = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def call(tmp_path: Path) -> Hlp:
    """`hlp` in an empty folder, with conf/'s real composition over stand-in alternatives."""
    conf = tmp_path / "conf"
    for group in ("method", "experiment", "reporting"):
        shutil.copytree(config_folder() / group, conf / group)
    shutil.copy(config_folder() / "config.yaml", conf)
    for group, names in STAND_INS.items():
        (conf / group).mkdir()
        for name in names:
            (conf / group / f"{name}.yaml").write_text(f"name: {name}\nsize: 1\n")
    (conf / "alternatives.yaml").write_text("{}")
    (conf / "ladder.yaml").write_text("{}")
    (conf / "experiment" / "mine.yaml").write_text(
        "# @package _global_\n"
        "defaults:\n  - override /method: paper\n  - override /encoder: pca\n\n"
        "name: mine\nvoting:\n  size: 7\n"
    )
    (tmp_path / "driver.py").write_text(DRIVER)

    def run(*arguments: str, **variables: str) -> "subprocess.CompletedProcess[str]":
        environment = {**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])}
        return subprocess.run(
            [sys.executable, "driver.py", *arguments],
            cwd=tmp_path,
            env=environment | variables,
            capture_output=True,
            text=True,
            check=False,
        )

    return run


def seen(folder: Path) -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = json.loads((folder / "seen.json").read_text())
    return found


def choices(folder: Path) -> dict[str, str]:
    return {group: seen(folder)[group]["name"] for group in STAND_INS}


def test_the_package_is_the_command_line_too() -> None:
    command = [sys.executable, "-m", "hlp", "--version"]
    environment = {**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == f"hlp {hlp.__version__}\n"


def test_default_run_is_the_demo(call: Hlp, tmp_path: Path) -> None:
    done = call("run")
    assert done.returncode == 0
    assert "running 0" in done.stdout
    (folder,) = (tmp_path / "outputs" / "demo").iterdir()
    assert choices(folder) == {group: names[0] for group, names in STAND_INS.items()}
    assert seen(folder)["output"] == str(folder)
    assert (folder / ".hydra" / "config.yaml").is_file()


def test_method_chooses_and_the_command_line_wins(call: Hlp, tmp_path: Path) -> None:
    call("run", "encoder=pca", "method=paper", "refinement=icp", "output=out")
    found = choices(tmp_path / "out")
    assert found["voting"] == "sequential"
    assert found["codebook"] == "kd_forest"
    assert found["encoder"] == "pca"
    assert found["refinement"] == "icp"


def test_experiment_wins_over_method_and_loses_to_the_command_line(
    call: Hlp, tmp_path: Path
) -> None:
    call("run", "experiment=mine", "codebook=exact", "output=out")
    found = choices(tmp_path / "out")
    assert found["voting"] == "sequential"  # of the method that the experiment chose
    assert found["encoder"] == "pca"  # of the experiment itself
    assert found["codebook"] == "exact"  # of the command line
    assert seen(tmp_path / "out")["voting"]["size"] == 7
    call("run", "experiment=mine", "method=hlp", "voting.size=9", "output=other")
    assert choices(tmp_path / "other")["voting"] == "joint"
    assert seen(tmp_path / "other")["voting"]["size"] == 9


@pytest.mark.slow
@pytest.mark.thorough
def test_arms_of_a_sweep_have_folders_of_their_own(call: Hlp, tmp_path: Path) -> None:
    done = call("-m", "refinement=pso,icp", "output=sweep")
    assert done.returncode == 0
    assert [choices(tmp_path / "sweep" / arm)["refinement"] for arm in "01"] == ["pso", "icp"]


@pytest.mark.slow
@pytest.mark.thorough
def test_failed_arm_stops_no_other(call: Hlp, tmp_path: Path) -> None:
    done = call("run", "-m", "seed=13,1", "output=sweep")
    assert done.returncode == 1
    assert "data.root: no folder /nowhere" in done.stdout
    assert seen(tmp_path / "sweep" / "1")["seed"] == 1


@pytest.mark.parametrize(
    ("argument", "word"),
    [("sede=1", "sede"), ("encoder=none", "contrastive"), ("seed=13", "data.root")],
)
def test_error_is_one_message_that_names_the_key(call: Hlp, argument: str, word: str) -> None:
    failed = call("run", argument)
    assert failed.returncode == 1
    assert failed.stderr.startswith("hlp: ")
    assert word in failed.stderr
    assert "Traceback" not in failed.stderr
    assert "Traceback" in call("run", argument, HLP_TRACEBACK="1").stderr


def test_bug_keeps_its_traceback(call: Hlp) -> None:
    failed = call("run", "seed=14")
    assert failed.returncode == 1
    assert "KeyError: 'a bug'" in failed.stderr
    assert "in build_run" in failed.stderr


def test_bench_is_a_task_of_its_own_on_the_same_data(call: Hlp, tmp_path: Path) -> None:
    done = call("bench", "experiment=mine", "frames=3", "output=out")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "out" / "seen.json").read_text())
    assert (found["task"]["name"], found["name"], found["frames"]) == ("bench", "mine", 3)


@pytest.mark.slow
@pytest.mark.thorough
def test_anytime_is_a_sweep_of_budgets(call: Hlp, tmp_path: Path) -> None:
    (tmp_path / "conf" / "refinement" / "pso.yaml").write_text("name: pso\nbudget_ms: 0.0\n")
    done = call("run", "experiment=anytime", "output=sweep")
    assert done.returncode == 0, done.stderr
    arms = sorted((tmp_path / "sweep").glob("*/seen.json"), key=lambda path: path.parent.name)
    budgets = [json.loads(path.read_text())["refinement"]["budget_ms"] for path in arms]
    assert budgets == [0, 5, 10, 20, 40]
    call("-m", "experiment=anytime", "refinement.budget_ms=5,7", "output=other")
    assert len(list((tmp_path / "other").glob("*/seen.json"))) == 2


Said = pytest.CaptureFixture[str]


def test_a_bare_command_lists_the_commands_and_an_unknown_one_is_named(capsys: Said) -> None:
    main([])
    usage = capsys.readouterr().out
    assert "\n  run " in usage and "\n  report " in usage
    main(["--help"])
    assert capsys.readouterr().out == usage
    with pytest.raises(SystemExit) as ended:
        main(["rnu"])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert "no command 'rnu': did you mean run?" in said and usage.strip() in said


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
    command: str, words: str, capsys: Said, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(command.split())
    assert ended.value.code == 1
    said = capsys.readouterr().err
    assert said.startswith("hlp: ") and words in said


def test_report_compares_two_runs(
    capsys: Said, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, right in (("a", False), ("b", True)):
        score = TargetScore(1, 2, 6, True, 1.0, 0.009, 0.1, 0.009, 0.9, right, True, True)
        write_scores(tmp_path / name / "scores.csv", [score], {6: "cat"})
    main(["report", "runs=[a, b]"])
    assert "Changed verdicts of ADD(-S): 1" in capsys.readouterr().out
