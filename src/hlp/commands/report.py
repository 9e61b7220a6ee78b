"""`hlp report`: tables and pictures of finished runs."""

from collections.abc import Sequence
from pathlib import Path

from hlp.commands import composing
from hlp.commands.tracking_uri import tracking_uri
from hlp.errors import HlpError


def command(arguments: Sequence[str]) -> None:
    """Print the report that the arguments ask for; exits with 2 if they are wrong."""
    keys = ("experiment", "output", "format", "objects", "runs", "uri", "details")
    given = composing.key_values(arguments, keys, REPORT_HELP, switches=("details",))
    if given is None:
        return
    from hlp.reporting.experiments import describe_reports
    from hlp.reporting.report import describe_named, report_runs, write_pages
    from hlp.reporting.run_list import report_selection

    layout = given.get("format", "text")
    folder = Path(given.get("output") or Path("outputs", given.get("experiment", "")))
    try:
        if "runs" in given:
            print(describe_named(given["runs"], given.get("uri") or tracking_uri(), layout))
        elif "objects" in given:
            print(report_selection(folder, given["objects"], layout))
        else:
            print(report_runs(folder, layout, given.get("details") == "true"))
            if words := describe_reports(folder, layout):
                print(f"\n{words}")
            print()
            for page in write_pages(folder):
                print(f"Report: {page}")
    except HlpError as error:
        composing.fail(error)


REPORT_HELP = """\
usage: hlp report [experiment=NAME] [output=DIR] [details=true]
                  [format=text|markdown]
       hlp report 'objects=[A,B,…]' [output=DIR]
       hlp report 'runs=[A,B,…]' [uri=MLFLOW]

Reports finished runs: all below outputs/, those of one experiment
(outputs/NAME), or those in or below any other folder (output=DIR).

One run has its tables, with the paper's numbers beside ours for LINEMOD's
objects. Several have a line each (details=true: also their tables), sweeps a
table of their runs with differences to the default. For fig9a, fig9b, fig9c,
table1, table2 and pso_vs_icp, the paper's figure or table is written into the
folder of each sweep or run, as PNG, SVG, Markdown, CSV and LaTeX; for
recordings one table of all data sets; for ladder a table and a figure of all
steps.

Into the folder of every run and sweep goes report.html, one page for a browser,
without any other file or network: charts, the targets with pictures of the
missed ones, a 3D view, the configuration, and the command that repeats it. The
page of a study (oracle, basin, bench, search) has its tables and figures.

  objects   prints the recall of these objects, over all targets and by visible
            fraction
  runs      compares two runs target by target: the difference of their recalls
            with its interval, McNemar's test, and the targets whose verdict
            changed. Of three or more, such as repeats with other seeds: recalls
            of each, mean and standard deviation. They are output folders or ids
            of runs in MLflow (default: uri=sqlite:///work/mlflow.db)

hlp report output=outputs/demo/2026-11-21_10-00-00    one run
hlp report experiment=fig9b                           the paper's Fig. 9b
hlp report 'runs=[outputs/a,outputs/b]'               is b better than a?
hlp report 'runs=[outputs/s0,outputs/s1,outputs/s2]'  how far apart?"""
