"""The size of the project has limits: what a change adds, it pays for, or says why one moves."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LIMITS = {
    "lines of src": 36_660,  # aim: 24,000
    "modules of src": 222,
    "lines of tests": 32_070,  # aim: 22,000
    "files of conf": 59,
    "words of docs": 12_157,
    "words of README": 600,
    "words of CHANGELOG": 800,
}
"""Above the aims, the limits are the size of today; a commit that raises one says what for."""


def files(folder: str, ending: str) -> list[Path]:
    """The files below a folder that git tracks, or would track."""
    command = ["git", "ls-files", "-co", "--exclude-standard", "-z", "--", folder]
    listed = subprocess.check_output(command, cwd=ROOT, text=True).split("\0")
    paths = (ROOT / name for name in listed if name.endswith(ending))
    return [path for path in paths if path.is_file()]


def lines(paths: list[Path]) -> int:
    """Lines of all files."""
    return sum(len(path.read_text().splitlines()) for path in paths)


def words(paths: list[Path]) -> int:
    """Words of all files, as `wc -w` counts them."""
    return sum(len(path.read_text().split()) for path in paths)


def sizes() -> dict[str, int]:
    """What the limits are for, counted."""
    return {
        "lines of src": lines(files("src", ".py")),
        "modules of src": len(files("src", ".py")),
        "lines of tests": lines(files("tests", ".py")),
        "files of conf": len(files("conf", ".yaml")),
        "words of docs": words(files("docs", ".md")),
        "words of README": words([ROOT / "README.md"]),
        "words of CHANGELOG": words([ROOT / "CHANGELOG.md"]),
    }


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="only a checkout is counted")
@pytest.mark.parametrize("what", LIMITS)
def test_the_budget_is_kept(what):
    assert sizes()[what] <= LIMITS[what]


if __name__ == "__main__":
    for name, size in sizes().items():
        print(f"{name:<20}{size:>8}  of {LIMITS[name]}")
