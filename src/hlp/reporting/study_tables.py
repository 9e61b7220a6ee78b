"""Tables and CSV files of the studies: oracle, basin, search, bench; two benches side by side."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from hlp.errors import DataError
from hlp.files import read_csv, read_json, write_csv, write_text
from hlp.reporting.table import Table, format_share, lay_out, prose

Result = Mapping[str, Any]

ALL_TARGETS = "all targets"


def head_of(region: str, coarse: str) -> str:
    """The short name of a cell of the oracle matrix: its region and its coarse pose."""
    return f"{region}/{coarse}".replace("estimated", "est")


def oracle_table(result: Result) -> Table:
    """A row an object and one for all targets, a column for each pair of region and coarse pose."""
    found = [{**cell["per_object"], ALL_TARGETS: cell["add"]} for cell in result["cells"]]
    rows = [
        [name, str(first["targets"]), *(_recall(recalls[name]) for recalls in found)]
        for name, first in found[0].items()
    ]
    heads = [head_of(cell["region"], cell["coarse"]) for cell in result["cells"]]
    return Table(["region/coarse", "targets", *heads], rows)


def _recall(recall: Mapping[str, Any]) -> str:
    low, high = recall["ci95"]
    return f"{recall['recall']:.3f} ({low:.2f}-{high:.2f})"


def format_oracle(result: Result, layout: str = "text") -> str:
    """The table (`text` or `markdown`) with its caption, and the recall that each stage lost."""
    lost = ", ".join(f"{stage} {share:+.3f}" for stage, share in result["lost"].items())
    caption = (
        f"ADD(-S) recall (95 % interval) of {result['frames']} frames. Columns are region and"
        " coarse pose: est = estimated, true = replaced by the truth. The fine pose is always"
        " estimated. The true coarse pose is given only if the region shows any part of the target."
    )
    conclusion = (
        f"Recall lost by each stage: {lost}. A wrong choice among the hypotheses counts as a"
        " loss of the coarse pose."
    )
    parts = [prose(caption, layout), lay_out(oracle_table(result), layout)]
    return "\n\n".join([*parts, prose(conclusion, layout)])


ALL = "all"
_CELL = ["refiner", "object", "rotation_deg", "translation_mm"]
_BASIN = [*_CELL, "perturbations", "right", "add_recall"]


def basin_cells(tried: pd.DataFrame) -> pd.DataFrame:
    """What basin.csv holds: recall by refiner, object (all first) and pair of starting errors.

    `tried` has a row for each refined pose: refiner, object, both errors, and whether it is right.
    """
    groups = [
        part.assign(object=name)
        for _, own in tried.groupby("refiner", sort=False)
        for name, part in [(ALL, own), *own.groupby("object", sort=False)]
    ]
    cells = pd.concat(groups).groupby(_CELL, sort=False)["right"]
    return cells.agg(perturbations="size", right="sum", add_recall="mean").reset_index()


def write_basins(folder: Path, cells: pd.DataFrame) -> None:
    """Write basin.md, and basin.csv: a row a refiner, object and pair of starting errors."""
    write_text(folder / "basin.md", format_basins(cells, "markdown") + "\n")
    write_csv(folder / "basin.csv", _BASIN, cells[_BASIN].to_numpy().tolist())


def read_mean_recalls(path: Path) -> dict[str, float]:
    """Recall of all objects by refiner, the mean over all starting errors, from basin.csv.

    Raises MissingFileError, and DataError for another file.
    """
    cells = pd.DataFrame(read_csv(path, _BASIN), columns=_BASIN)
    try:
        whole = cells[cells["object"] == ALL].astype({"add_recall": float})
    except ValueError as error:
        raise DataError(f"{path}: a recall is no number ({error})") from error
    means: dict[str, float] = whole.groupby("refiner", sort=False)["add_recall"].mean().to_dict()
    return means


def format_basins(cells: pd.DataFrame, layout: str = "text") -> str:
    """Tables for people (`text` or `markdown`): recall by pair of errors, and means per object."""
    caption = (
        "ADD(-S) recall after refinement, by the error of the start: a row for each rotation"
        " (degrees), a column for each translation (mm)."
    )
    parts = [prose(caption, layout)]
    for refiner, own in cells[cells["object"] == ALL].groupby("refiner", sort=False):
        recalls = recalls_by_errors(own)
        rows = [[f"{degrees:g}", *map("{:.2f}".format, row)] for degrees, row in recalls.iterrows()]
        header = [str(refiner), *map("{:g}".format, recalls.columns)]
        parts.append(lay_out(Table(header, rows), layout))
    means = cells.pivot_table("add_recall", "object", "refiner", sort=False)
    counts = cells.groupby("object", sort=False)["perturbations"].first()
    rows = [
        [str(name), str(counts[name]), *map("{:.3f}".format, row)] for name, row in means.iterrows()
    ]
    parts.append("Mean over all starting errors:")
    header = ["object", "perturbations each", *means.columns]
    return "\n\n".join([*parts, lay_out(Table(header, rows), layout)])


def recalls_by_errors(cells: pd.DataFrame) -> pd.DataFrame:
    """Recalls of one refiner and object: rotation errors down, translation errors across."""
    return cells.pivot_table("add_recall", "rotation_deg", "translation_mm", sort=False)


_TRIALS = 10  # that are shown


def format_search(result: Result, layout: str = "text") -> str:
    """The best trials within the time limit, and the overrides of the best one.

    `result` is what `search.json` holds, `layout` is `text` or `markdown`.
    """
    limit, best = result["limit_ms"], result["best"]
    succeeded = [trial for trial in result["trials"] if trial["error"] is None]
    heading = (
        f"{len(result['trials'])} trials of {result['space']}, {len(succeeded)} of them with a"
        f" result; limit {limit:g} ms (median time of one object in one frame)"
    )
    conclusion = f"No trial within {limit:g} ms."
    if best is not None:
        overrides = " ".join(f"{key}={value}" for key, value in best["values"].items())
        conclusion = f"Best within the limit: {overrides}"
        if best["trial"] == 0:
            conclusion += " (unchanged: no other trial is surely better)"
    table = [lay_out(trials_table(result), layout)] if succeeded else []
    return "\n\n".join([prose(heading, layout), *table, prose(conclusion, layout)])


def trials_table(result: Result) -> Table:
    """The ten best trials: those within the limit first, by recall, then by time."""
    limit = result["limit_ms"]
    succeeded = [trial for trial in result["trials"] if trial["error"] is None]
    ranked = sorted(succeeded, key=lambda t: (t["time_ms"] > limit, -t["recall"], t["time_ms"]))
    keys, rows = list(result["trials"][0]["values"]), []
    for trial in ranked[:_TRIALS]:
        time = f"{trial['time_ms']:.0f}" + (" (over)" if trial["time_ms"] > limit else "")
        values = (trial["values"][key] for key in keys)
        shown = [f"{value:.3g}" if isinstance(value, float) else str(value) for value in values]
        rows.append([str(trial["trial"]), f"{trial['recall']:.3f}", time, *shown])
    return Table(["trial", "ADD(-S) recall", "ms", *(key.rpartition(".")[2] for key in keys)], rows)


def write_search(folder: Path, result: Result) -> None:
    """Write search.csv, one row a trial, and search.md."""
    write_text(folder / "search.md", format_search(result, "markdown") + "\n")
    keys = list(result["trials"][0]["values"])
    rows = [
        [t["trial"], *(t["values"][k] for k in keys), t["recall"], t["time_ms"], t["error"] or ""]
        for t in result["trials"]
    ]
    write_csv(folder / "search.csv", ["trial", *keys, "add_recall", "median_ms", "error"], rows)


CONFIGURED = "configured"
"""Name of the path that the configuration itself describes; the others are compared with it."""
TIMED = ("first", "further", "frame")
"""Units that are timed."""
TOTAL = "total"
_TIMES = ("median_ms", "p95_ms", "cpu_ms")


def format_bench(result: Result, layout: str = "text") -> str:
    """All tables of a bench (`text` or `markdown`), and what it was measured on."""
    workload = (f"{name.replace('_', ' ')} {value}" for name, value in result["workload"].items())
    parts: list[str | Table] = [_machine(result["machine"]), ", ".join(workload)]
    for name, path in result["paths"].items():
        parts += [
            f"Path '{name}': median ms of a frame's first object, of each further one and of whole"
            " frames, with the 95th percentile and the CPU time of all threads. Decoding the images"
            " is not counted.",
            times_table(path),
        ]
    if len(result["paths"]) > 1:
        parts += [
            "Median ms, and how many times the configured path's; of stages for the first object."
            " Same pose: share of those within {mm:g} mm and {deg:g} degrees of that path's."
            "".format(**result["tolerance"]),
            comparison_table(result["paths"]),
        ]
    loading, objects = result["loading_s"], [*result["loading_s"]["objects"].values()]
    parts += [
        f"Loading (s): classifier {loading['classifier']:.2f}, encoder {loading['encoder']:.2f},"
        f" each object {sum(objects) / len(objects):.2f} (at most {max(objects):.2f}).",
        f"Peak memory: {result['memory']['peak_mib']:.0f} MiB with all objects loaded.",
    ]
    laid_out = (
        lay_out(part, layout) if isinstance(part, Table) else prose(part, layout) for part in parts
    )
    return "\n\n".join(laid_out)


def times_table(path: Result) -> Table:
    """A row a part and stage, and the total: median, 95th percentile and CPU time of each unit."""
    units = [unit for unit in TIMED if path[unit]]
    rows = [
        [part, *(format_ms(path[unit][part][time]) for unit in units for time in _TIMES)]
        for part in path["first"]
    ]
    return Table(["part", *(name for unit in units for name in (unit, "95 %", "CPU"))], rows)


def comparison_table(paths: Mapping[str, Result]) -> Table:
    """A row a path: median ms, and how many times those of the first path; recall; same poses."""
    first = next(iter(paths.values()))
    stages = [part for part in first["first"] if part.startswith("stage ") or part == TOTAL]
    rows = []
    for name, path in paths.items():
        times = [_ratio(first["first"][stage], path["first"][stage]) for stage in stages]
        times.append(_ratio(first["frame"][TOTAL], path["frame"][TOTAL]))
        rows.append([name, *times, *map(format_share, (path["add_recall"], path["same_pose"]))])
    return Table(["path", *stages, "frame", "ADD(-S)", "same pose"], rows)


def compare_benches(before: Path, after: Path) -> str:
    """Two saved results side by side: median times and their ratio, after/before.

    Only paths that both results have are compared. Raises DataError for a file that is no
    bench, and MissingFileError where there is none.
    """
    saved = {"A": before, "B": after}
    results = {name: read_bench(path) for name, path in saved.items()}
    parts = [
        prose(f"{name}  {saved[name]}: {_machine(result['machine'])}", "text")
        for name, result in results.items()
    ]
    one, other = (result["workload"] for result in results.values())
    differing = [
        f"{key} {one[key]} and {other.get(key)}" for key in one if one[key] != other.get(key)
    ]
    if differing:
        parts.append(prose(f"The two did not measure the same: {'; '.join(differing)}.", "text"))
    for name in results["A"]["paths"]:
        if name in results["B"]["paths"]:
            paths = {key: result["paths"][name] for key, result in results.items()}
            table = comparison_table(paths).without("same pose")
            parts += [f"Path '{name}', median ms:", lay_out(table, "text")]
    peaks = [result["memory"]["peak_mib"] for result in results.values()]
    return "\n\n".join([*parts, "Peak memory: {:.0f} and {:.0f} MiB.".format(*peaks)])


def read_bench(path: Path) -> dict[str, Any]:
    """Read bench.json. Raises DataError naming a file that is not one."""
    result: dict[str, Any] = read_json(path)
    missing = {"machine", "workload", "paths", "memory"} - set(result)
    if missing:
        raise DataError(f"{path} is no bench: it lacks {', '.join(sorted(missing))}")
    return result


def _ratio(first: Result, own: Result) -> str:
    """`15.0 x1.50`: takes half as long again."""
    before, after = first["median_ms"], own["median_ms"]
    return format_ms(after) + (f" x{after / before:.2f}" if before else "")


def _machine(machine: Result) -> str:
    return "{cpu}, {cores} cores; threads: {threads}; load before: {load:.2f}".format(**machine)


def format_ms(value: float) -> str:
    """Milliseconds, with a decimal below 100."""
    return f"{value:.1f}" if value < 100 else f"{value:.0f}"
