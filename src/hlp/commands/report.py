"""`hlp report`: tables and pictures of finished runs."""

import sys
from collections.abc import Sequence
from pathlib import Path

from hlp.commands import composing
from hlp.errors import HlpError

MLFLOW = "sqlite:///work/mlflow.db"


def command(arguments: Sequence[str]) -> None:
    """Print the report that the arguments ask for; exits with 2 if they are wrong."""
    try:
        keys = ("experiment", "output", "format", "objects", "runs", "uri")
        given = composing.key_values(arguments, keys)
    except HlpError as error:
        print(f"hlp report: {error}\n\n{REPORT_HELP}", file=sys.stderr)
        sys.exit(2)
    if given is None:
        print(REPORT_HELP)
        return
    from hlp.reporting.comparison import compare
    from hlp.reporting.ladder import describe_ladders
    from hlp.reporting.page.pages import write_pages
    from hlp.reporting.recordings import describe_recordings
    from hlp.reporting.report import report_runs
    from hlp.reporting.reproductions import describe_reproductions
    from hlp.reporting.selection import report_selection

    layout = given.get("format", "text")
    folder = Path(given.get("output") or Path("outputs", given.get("experiment", "")))
    try:
        if "runs" in given:
            print(compare(given["runs"], given.get("uri", MLFLOW), layout))
        elif "objects" in given:
            print(report_selection(folder, given["objects"], layout))
        else:
            print(report_runs(folder, layout))
            print(describe_reproductions(folder, layout))
            print(describe_recordings(folder, layout))
            print(describe_ladders(folder, layout))
            for page in write_pages(folder):
                print(f"Report: {page}")
    except HlpError as error:
        composing.fail(error)


REPORT_HELP = """\
usage: hlp report [experiment=NAME] [output=DIR] [format=text|markdown]
       hlp report 'objects=[A,B,…]' [output=DIR]
       hlp report 'runs=[A,B]' [uri=MLFLOW]

Prints tables of finished runs, with the paper's numbers beside ours for LINEMOD's objects: of all
runs below outputs/, of one experiment (outputs/NAME), or below any other folder (output=DIR). For
fig9a, fig9b, fig9c, table1, table2 and pso_vs_icp, the paper's figure or table is written into the
folder of each sweep or run, as PNG, SVG, Markdown, CSV and LaTeX. For recordings it is one table of
all data sets, as Markdown and CSV; for ladder a table and a figure of all arms. report.html, in the
folder of every run and sweep, is one page for a browser with charts, missed targets and their
pictures, a 3D view, and the configuration; it needs no network.

objects=[A,B,…] prints the recall of these objects, over all targets and by visible fraction.

runs=[A,B] compares two runs target by target: the difference of their recalls with its interval,
McNemar's test, and the targets whose verdict changed. A and B are output folders or ids of runs in
MLflow (default: uri=sqlite:///work/mlflow.db)."""
