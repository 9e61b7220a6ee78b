"""The command line in processes of its own, with stand-ins for all groups and for the run."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import hlp
from hlp.commands.composing import config_folder
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
import hlp.cli, hlp.config

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
hlp.commands.composing.config_folder = lambda: Path("conf").absolute()
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


def test_bare_command_lists_the_commands(call: Hlp) -> None:
    bare = call()
    assert bare.returncode == 0
    assert "\n  run " in bare.stdout
    assert "\n  report " in bare.stdout
    assert call("--help").stdout == bare.stdout


def test_the_package_is_the_command_line_too() -> None:
    command = [sys.executable, "-m", "hlp", "--version"]
    environment = {**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == f"hlp {hlp.__version__}\n"


def test_unknown_command_is_named(call: Hlp) -> None:
    wrong = call("rnu")
    assert wrong.returncode == 2
    assert "no command 'rnu'" in wrong.stderr
    assert "\n  run " in wrong.stderr


def test_help_of_run_lists_groups_and_examples(call: Hlp) -> None:
    shown = call("run", "--help")
    assert shown.returncode == 0
    assert "refinement: icp, paper, pso" in shown.stdout
    assert "output=DIR" in shown.stdout


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


def test_report_refuses_what_it_does_not_take(call: Hlp) -> None:
    wrong = call("report", "experimnt=demo")
    assert wrong.returncode == 2
    assert "'experimnt=demo'" in wrong.stderr


def test_report_without_runs_says_where_it_looked(call: Hlp) -> None:
    empty = call("report", "experiment=demo")
    assert empty.returncode == 1
    assert empty.stderr.startswith("hlp: ")
    assert str(Path("outputs", "demo")) in empty.stderr


def test_report_compares_two_runs(call: Hlp, tmp_path: Path) -> None:
    for name, right in (("a", False), ("b", True)):
        score = TargetScore(1, 2, 6, True, 1.0, 0.009, 0.1, 0.009, 0.9, right, True, True)
        write_scores(tmp_path / name / "scores.csv", [score], {6: "cat"})
    compared = call("report", "runs=[a, b]")
    assert compared.returncode == 0
    assert "Changed verdicts of ADD(-S): 1" in compared.stdout
    one = call("report", "runs=[a]")
    assert one.returncode == 1
    assert "runs=[a]: name two" in one.stderr


def test_bench_is_a_task_of_its_own_on_the_same_data(call: Hlp, tmp_path: Path) -> None:
    done = call("bench", "experiment=mine", "frames=3", "output=out")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "out" / "seen.json").read_text())
    assert (found["task"]["name"], found["name"], found["frames"]) == ("bench", "mine", 3)
    assert call("bench", "--help").stdout.startswith("usage: hlp bench")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["compare=a.json"], "name two bench.json"),
        (["compare=[a.json,b.json]", "frames=3"], "leave frames=3 out"),
        (["compare=[a.json,b.json]"], "a.json"),
    ],
)
def test_bench_says_what_it_cannot_compare(call: Hlp, arguments: list[str], words: str) -> None:
    failed = call("bench", *arguments)
    assert failed.returncode == 1
    assert failed.stderr.startswith("hlp: ") and words in failed.stderr


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


def test_clean_lists_and_removes_only_if_told_to(tmp_path: Path) -> None:
    """Without stand-ins: what a crashed run left lies in the folder."""
    partial = tmp_path / "work" / "views" / f"{'a' * 16}.partial"
    partial.mkdir(parents=True)
    (partial / "half").write_bytes(bytes(2_000_000))

    def clean(*arguments: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-c", "from hlp.cli import main; main()", "clean", *arguments]
        environment = {**os.environ, "PYTHONPATH": str(Path(hlp.__file__).parents[1])}
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )

    listed = clean()
    assert listed.returncode == 0, listed.stderr
    assert listed.stdout.split()[:3] == ["partial", "2.0", "MB"]
    assert "Nothing was removed" in listed.stdout and partial.exists()
    assert clean("dry=false", "kinds=damaged").returncode == 0 and partial.exists()
    assert "1 outputs removed, 2.0 MB" in clean("dry=false").stdout
    assert not partial.exists()
    assert clean("dry=perhaps").returncode == 2
    missing = clean("work=nowhere")
    assert missing.returncode == 1 and missing.stderr.startswith("hlp: there is no folder nowhere")
