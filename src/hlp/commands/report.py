"""`hlp report`, `runs`, `ui` and `upload`: finished runs as tables and pages, and in MLflow."""

import os
import sys
import time
import webbrowser
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from hlp.commands.arguments import is_true, known_arguments, tracking_uri, whole_number
from hlp.errors import InputError, without_controls
from hlp.reporting import report as reports
from hlp.reporting.experiments import describe_reports
from hlp.reporting.mlflow import is_local
from hlp.reporting.mlflow.pages import PORT, newest_page, server
from hlp.reporting.mlflow.upload import send_runs, unsent_database
from hlp.reporting.table import LAYOUTS


def report(arguments: Sequence[str]) -> None:
    """Print the report that the arguments ask for."""
    keys = ("experiment", "output", "format", "objects", "runs", "uri", "details")
    given = known_arguments(arguments, keys, "report")
    layout, details = _layout(given), is_true(given, "details", False)
    folder = Path(given.get("output") or Path("outputs", given.get("experiment", "")))
    if "runs" in given:
        _print(reports.describe_named(given["runs"], given.get("uri") or tracking_uri(), layout))
    elif "objects" in given:
        _print(reports.report_selection(folder, given["objects"], layout))
    else:
        _print(reports.report_runs(folder, layout, details))
        if words := describe_reports(folder, layout):
            _print(f"\n{words}")
        print()
        for page in reports.write_pages(folder):
            print(f"Report: {page}")


def _print(text: str) -> None:
    print(without_controls(text))


def runs(arguments: Sequence[str]) -> None:
    """Print the list of runs."""
    given = known_arguments(arguments, ("output", "format"), "runs")
    _print(reports.describe_outputs(Path(given.get("output", "outputs")), _layout(given)))


def _layout(given: Mapping[str, str]) -> str:
    layout = given.get("format", "text")
    if layout not in LAYOUTS:
        raise InputError(f"format={layout}: choose one of {', '.join(LAYOUTS)}")
    return layout


def ui(arguments: Sequence[str]) -> None:
    """Start MLflow's server and show its address until Ctrl-C; of a server show the page alone."""
    given = known_arguments(arguments, ("uri", "work", "experiment", "port", "open"), "ui")
    opened = is_true(given, "open", True)
    port = whole_number(given, "port", most=65535) or PORT
    uri = given.get("uri") or tracking_uri(given.get("work", "work"))
    page = newest_page(uri, given.get("experiment"))
    if not is_local(uri):
        _show(uri.rstrip("/") + page, opened)
        return
    with server(uri, port) as address:
        _show(address + page, opened)
        print("Stop it with Ctrl-C.", flush=True)
        with suppress(KeyboardInterrupt):
            while True:
                time.sleep(3600)


def _show(page: str, opened: bool) -> None:
    print(f"Runs: {page}", flush=True)
    print("Choose 'Model training' at MLflow's top left, once; × closes its assistant.", flush=True)
    # Without a screen, some systems would open a browser made of text in this terminal.
    screen = sys.platform in ("darwin", "win32") or {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ}
    if screen and opened:
        webbrowser.open(page)


def upload(arguments: Sequence[str]) -> None:
    """Send the runs that were kept here, and print their names."""
    given = known_arguments(arguments, ("work", "unsent", "uri"), "upload")
    unsent = given.get("unsent") or unsent_database(Path(given.get("work", "work")))
    names = send_runs(unsent, given.get("uri"))
    print("\n".join([*names, f"{len(names)} runs sent"]))
