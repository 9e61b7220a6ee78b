"""The wheel of this checkout: installed once for all tests, and used from an empty folder.

Nobody who uses it here has a name, a home, or the right to write into the package.
"""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

CHECKOUT = Path(__file__).parents[1]
NO_HOME = {"HOME": "/proc/nowhere", "XDG_CACHE_HOME": "/proc/nowhere/cache"}
_NAMELESS = ("unshare", "--user", "--map-user=54321", "--map-group=54321")


@cache
def as_nobody() -> tuple[str, ...]:
    """What starts a command as a user without a name, to whom permission bits apply.

    Root is such a user in a name space of its own. Empty where the machine allows none.
    """
    if shutil.which("unshare") is None:
        return ()
    tried = subprocess.run([*_NAMELESS, "true"], capture_output=True, check=False)
    return _NAMELESS if tried.returncode == 0 else ()


@dataclass(frozen=True)
class WheelFolder:
    """A folder that pip installed the wheel into, and an empty one to work in."""

    folder: Path

    @property
    def package(self) -> Path:
        return self.folder / "installed"

    @property
    def place(self) -> Path:
        return self.folder / "place"

    @property
    def variables(self) -> dict[str, str]:
        """The environment: no checkout, no home, one thread, and caches of this folder's own."""
        own = {"PYTHONPATH": str(self.package), "PYTHONDONTWRITEBYTECODE": "1"}
        own |= {"OMP_NUM_THREADS": "1", "TMPDIR": str(self.folder / "temporary")}
        return {**os.environ, **NO_HOME, **own}

    def call(self, *command: str) -> "subprocess.CompletedProcess[str]":
        """A command in the empty folder, by a user without a name where the machine allows it."""
        return subprocess.run(
            [*as_nobody(), *command],
            cwd=self.place,
            env=self.variables,
            capture_output=True,
            text=True,
            check=False,
        )

    def hlp(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        return self.call(sys.executable, str(self.package / "bin" / "hlp"), *arguments)

    def printed_by_hlp(self, *arguments: str) -> str:
        """What it prints; it must end well."""
        done = self.hlp(*arguments)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def files(self) -> set[Path]:
        return {path for path in self.package.rglob("*") if path.is_file()}


def install_wheel(folder: Path, **variables: str) -> WheelFolder:
    """Build the wheel and install it into a folder, where nobody may write afterwards.

    `variables` are those of the environment in which it is built.
    """
    made = WheelFolder(folder)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-index"]
    build = [*pip, "wheel", *offline, "--no-build-isolation", "-w", str(folder), str(CHECKOUT)]
    subprocess.run(build, check=True, cwd=folder, env={**os.environ, **variables})
    (wheel,) = folder.glob("hlp-*.whl")
    install = [*pip, "install", *offline, "--no-compile", "--target", str(made.package), str(wheel)]
    subprocess.run(install, check=True, cwd=folder)
    made.place.mkdir()
    (folder / "temporary").mkdir()
    forbid_writing(made.package)
    return made


def forbid_writing(folder: Path) -> None:
    """Take away from everybody the right to write into a folder and its files."""
    for path in [folder, *folder.rglob("*")]:
        path.chmod(path.stat().st_mode & ~0o222)
