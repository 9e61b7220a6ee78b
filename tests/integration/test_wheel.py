"""The wheel, installed without the checkout, used from an empty folder by someone with no home."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from hlp.files import read_json
from tiny_run import TINY

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).parents[2]
OUT = "outputs/mine"


@dataclass(frozen=True)
class Installed:
    """A folder that pip installed the wheel into, and an empty one to work in."""

    package: Path
    place: Path

    def hlp(self, *arguments: str, **variables: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, str(self.package / "bin" / "hlp"), *arguments]
        environment = {**os.environ, "PYTHONPATH": str(self.package), **variables}
        environment |= {"PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}
        return subprocess.run(
            command, cwd=self.place, env=environment, capture_output=True, text=True, check=False
        )

    def files(self) -> set[Path]:
        return {path for path in self.package.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    pytest.importorskip("hatchling", reason="the wheel is built with hatchling (extra: dev)")
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-index"]
    build = [*pip, "wheel", *offline, "--no-build-isolation", "-w", str(folder), str(CHECKOUT)]
    subprocess.run(build, check=True, cwd=folder)
    (wheel,) = folder.glob("hlp-*.whl")
    package, place = folder / "installed", folder / "place"
    install = [*pip, "install", *offline, "--no-compile", "--target", str(package), str(wheel)]
    subprocess.run(install, check=True, cwd=folder)
    place.mkdir()
    return Installed(package, place)


def test_it_holds_the_configuration_and_nothing_of_the_checkout_but_the_package(
    installed: Installed,
) -> None:
    inside = {path.name for path in installed.package.iterdir()}
    assert {each for each in inside if not each.endswith(".dist-info")} == {"hlp", "bin"}
    shipped = {path.relative_to(installed.package / "hlp" / "conf")
               for path in (installed.package / "hlp" / "conf").rglob("*.yaml")}  # fmt: skip
    assert shipped == {path.relative_to(CHECKOUT / "conf")
                       for path in (CHECKOUT / "conf").rglob("*.yaml")}  # fmt: skip
    where = "import hlp; print(hlp.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", where],
        cwd=installed.place,
        env={**os.environ, "PYTHONPATH": str(installed.package)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(done.stdout.strip()).is_relative_to(installed.package)


def test_help_and_configuration(installed: Installed) -> None:
    helped = installed.hlp("--help")
    assert helped.returncode == 0, helped.stderr
    assert "usage: hlp COMMAND" in helped.stdout
    shown = installed.hlp("run", "--cfg", "job")
    assert shown.returncode == 0, shown.stderr
    assert "\nrefinement:\n" in shown.stdout


@pytest.fixture(scope="module")
def own_run(installed: Installed) -> "subprocess.CompletedProcess[str]":
    """A run of the user's own experiment, where neither home nor package can be written."""
    own = installed.place / "my_conf" / "experiment" / "mine.yaml"
    own.parent.mkdir(parents=True)
    groups = [each.split("=") for each in TINY if each.startswith("encoder=")]
    values = [each.split("=") for each in TINY if not each.startswith("encoder=")]
    lines = ["# @package _global_", "defaults:"]
    lines += [f"  - override /{group}: {choice}" for group, choice in groups]
    lines += ["  - _self_", "name: mine"]
    own.write_text("\n".join([*lines, _nested(values)]) + "\n")
    temporary = installed.place.parent / "temporary"
    temporary.mkdir()
    nowhere = {"HOME": "/proc/nowhere", "XDG_CACHE_HOME": "/proc/nowhere/cache"}
    return installed.hlp(
        "run",
        *("--config-dir", "my_conf", "experiment=mine", f"output={OUT}", "machine.threads=1"),
        **nowhere,
        TMPDIR=str(temporary),
    )


def _nested(values: list[list[str]]) -> str:
    """Dotted keys as YAML. Keys that share a beginning are merged."""
    import yaml

    tree: dict[str, object] = {}
    for key, value in values:
        *parents, last = key.split(".")
        branch = tree
        for parent in parents:
            branch = branch.setdefault(parent, {})  # type: ignore[assignment]
        branch[last] = yaml.safe_load(value)
    return yaml.safe_dump(tree)


def test_a_users_own_experiment_runs_without_a_home(
    installed: Installed, own_run: "subprocess.CompletedProcess[str]"
) -> None:
    assert own_run.returncode == 0, own_run.stderr
    out = installed.place / OUT
    assert read_json(out / "manifest.json")["config"]["name"] == "mine"
    assert read_json(out / "summary.json")["targets"] > 0
    assert "<html" in (out / "report.html").read_text()
    assert {path.name for path in installed.place.iterdir()} <= {"my_conf", "outputs", "work"}


def test_nothing_is_written_into_the_package(
    installed: Installed, own_run: "subprocess.CompletedProcess[str]"
) -> None:
    record = next(installed.package.glob("hlp-*.dist-info")) / "RECORD"
    listed = {line.split(",")[0].removeprefix("../../") for line in record.read_text().split("\n")}
    present = {str(path.relative_to(installed.package)) for path in installed.files()}
    assert present <= listed


def test_the_run_is_listed_and_reported_again(
    installed: Installed, own_run: "subprocess.CompletedProcess[str]"
) -> None:
    listed = installed.hlp("runs")
    assert listed.returncode == 0, listed.stderr
    assert "mine" in listed.stdout
    (installed.place / OUT / "report.html").unlink()
    again = installed.hlp("report", f"output={OUT}")
    assert again.returncode == 0, again.stderr
    assert (installed.place / OUT / "report.html").is_file()


def test_notebooks_run_without_the_checkout(
    installed: Installed,
    own_run: "subprocess.CompletedProcess[str]",
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In the folder of the user's own run, whose stages and results they find."""
    pytest.importorskip("nbclient", reason="notebooks need the extra 'notebooks'")
    from notebook_runs import NOTEBOOKS, execute, pictures, printed

    monkeypatch.setenv("PYTHONPATH", str(installed.package))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel draws into the notebook
    overrides = [each for each in TINY if not each.startswith("panels")]
    first = f"OVERRIDES = {overrides}\nWORK = 'work'\nFRAME = 0"
    assert len(pictures(execute(NOTEBOOKS / "01_method.ipynb", first, installed.place))) == 7
    second = "OUTPUTS = 'outputs'\nDATABASE = 'work/mlflow.db'\nEXPERIMENT = 'mine'"
    told = printed(execute(NOTEBOOKS / "02_runs.ipynb", second, installed.place))
    assert "FINISHED" in told and "mine" in told
