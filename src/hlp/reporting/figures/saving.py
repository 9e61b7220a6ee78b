"""Figures as files."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save_jpeg(figure: "Figure", path: Path) -> None:
    """Write a figure as a JPEG. Raises OSError for a path that cannot be written."""
    figure.savefig(path, dpi=110, pil_kwargs={"quality": 88, "optimize": True})


def save_figure(figure: "Figure", path: Path) -> list[Path]:
    """Write `path`.png and `path`.svg; those files. Equal figures give equal files."""
    import matplotlib

    files = [path.with_name(f"{path.name}.{ending}") for ending in ("png", "svg")]
    with matplotlib.rc_context({"svg.hashsalt": "hlp"}):
        figure.savefig(files[0], dpi=150)
        figure.savefig(files[1], metadata={"Date": None})
    return files
