"""`hlp report`: tables of finished runs for the terminal and for Markdown, and their drawings."""

from pathlib import Path

from hlp.errors import MissingFileError
from hlp.files import SUMMARY, SWEEP
from hlp.reporting.figures.trade_off import draw_trade_off
from hlp.reporting.figures.waterfall_bars import draw_waterfall
from hlp.reporting.tables.summary_tables import (
    format_summary,
    runs_table,
    votes_table,
    waterfall_tables,
)
from hlp.reporting.tables.table import LAYOUTS, check_layout
from hlp.results.summary_file import read_summary


def report_runs(folder: Path, layout: str) -> str:
    """Tables of every run in or below a folder, oldest first, and all of them side by side.

    `layout` is `text` or `markdown`. Draws each run's waterfall into its folder, and recall against
    time into each sweep's. Raises ValueError for another layout or a broken summary, and
    MissingFileError where no finished run is found.
    """
    check_layout(layout)
    paths = sorted(folder.rglob(SUMMARY), key=lambda path: path.stat().st_mtime)
    if not paths:
        raise MissingFileError(f"no finished run ({SUMMARY}) in or below {folder}")
    summaries = {str(path.parent): read_summary(path) for path in paths}
    heading = "## " if layout == "markdown" else ""
    parts = []
    for name, summary in summaries.items():
        parts.append(f"{heading}{name}\n\n{format_summary(summary, layout)}")
        tables = (*waterfall_tables(summary), votes_table(summary))
        parts += [LAYOUTS[layout](table) for table in tables if table.rows]
        if waterfall_tables(summary):
            draw_waterfall(Path(name), summary["waterfall"])
            parts.append(f"Drawn: {Path(name, 'waterfall.png')} and .svg")
    for sweep in sorted(path.parent for path in folder.rglob(SWEEP)):
        parts += [f"Drawn: {path}" for path in draw_trade_off(sweep)]
    if len(summaries) > 1:
        parts.append(f"{heading}All runs\n\n{LAYOUTS[layout](runs_table(summaries))}")
    return "\n\n".join(parts)
