"""`hlp report`: tables of finished runs for the terminal and for Markdown, and their drawings."""

from pathlib import Path

from hlp.errors import MissingFileError
from hlp.files import SUMMARY, SWEEP
from hlp.reporting.figures.bench_bars import draw_waterfall
from hlp.reporting.figures.trade_off import draw_trade_off
from hlp.reporting.page.study_page import study_folders
from hlp.reporting.study_arms import read_study_sweeps
from hlp.reporting.study_sweep import describe_study_sweep, write_study_sweep
from hlp.reporting.sweep_report import describe_sweep, write_sweep_files
from hlp.reporting.tables.summary_tables import (
    format_summary,
    runs_table,
    votes_table,
    waterfall_tables,
)
from hlp.reporting.tables.table import check_layout, lay_out, prose
from hlp.results.summary_file import Summary, read_summary


def report_runs(folder: Path, layout: str, details: bool = False) -> str:
    """A line for each run in or below a folder, oldest first, and a table for each sweep.

    `layout` is `text` or `markdown`. The tables of a run follow if it is the only one, or with
    `details`. Of studies (oracle, basin, bench, search) there are the tables or their names. Draws
    each run's waterfall into its folder, and figures into each sweep's. Raises ValueError for
    another layout or a broken summary, and MissingFileError where no finished run is found.
    """
    check_layout(layout)
    sweeps = sorted(path.parent for path in folder.rglob(SWEEP))
    paths = sorted(folder.rglob(SUMMARY), key=lambda path: path.stat().st_mtime)
    studies = study_folders(folder)
    if not paths and not sweeps and not studies:
        raise MissingFileError(f"no finished run ({SUMMARY}) in or below {folder}")
    summaries = {path.parent: read_summary(path) for path in paths}
    heading = "## " if layout == "markdown" else ""
    parts = []
    for run, summary in summaries.items():
        drawn = _draw(run, summary)
        if details or len(summaries) == 1:
            parts.append(f"{heading}{run}\n\n{format_summary(summary, layout)}")
            tables = (*waterfall_tables(summary), votes_table(summary))
            parts += [lay_out(table, layout) for table in tables if table.rows]
            parts += [f"Drawn: {path}" for path in drawn]
    for sweep in sweeps:
        parts += _sweep_parts(sweep, layout, heading)
    parts += [_study_part(each, layout, heading) for each in studies if each.parent not in sweeps]
    if len(summaries) > 1:
        table = runs_table({str(run.relative_to(folder)): s for run, s in summaries.items()})
        shown = table.fitted(0, ends=True) if layout == "text" else table
        parts.append(f"{heading}All runs below {folder}\n\n{lay_out(shown, layout)}")
        if not details:
            parts.append("details=true prints the tables of every run.")
    return "\n\n".join(parts)


def _study_part(study: Path, layout: str, heading: str) -> str:
    """A study's tables as Markdown; for a terminal, which they are too wide for, their names."""
    tables = sorted(study.glob("*.md"))
    if layout == "markdown":
        return "\n\n".join([f"{heading}{study}", *(each.read_text("utf-8") for each in tables)])
    return prose(f"Study: {study} ({', '.join(each.name for each in tables)})", layout)


def _sweep_parts(sweep: Path, layout: str, heading: str) -> list[str]:
    """The tables of a sweep of runs or studies, and the files written."""
    if studies := read_study_sweeps(sweep):
        described = "\n\n".join(describe_study_sweep(each, layout) for each in studies)
        written = [path for each in studies for path in write_study_sweep(sweep, each)]
    else:
        described = describe_sweep(sweep, layout)
        written = [*write_sweep_files(sweep), *draw_trade_off(sweep)]
    if not written:
        return []
    names = ", ".join(path.name for path in written)
    return [f"{heading}{sweep}\n\n{described}", prose(f"Written: {sweep} ({names})", layout)]


def _draw(run: Path, summary: Summary) -> list[Path]:
    if not waterfall_tables(summary):
        return []
    draw_waterfall(run, summary["waterfall"])
    return [run / "waterfall.png", run / "waterfall.svg"]
