"""Results of a bench as tables, and two saved results side by side."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hlp.errors import DataError
from hlp.files import read_json
from hlp.reporting.table import Table, format_share, lay_out, prose

CONFIGURED = "configured"
"""Name of the path that the configuration itself describes; the others are compared with it."""
TIMED = ("first", "further", "frame")
"""Units that are timed."""
TOTAL = "total"
_TIMES = ("median_ms", "p95_ms", "cpu_ms")
Result = Mapping[str, Any]


def format_bench(result: Result, layout: str = "text") -> str:
    """All tables of a bench (`text` or `markdown`), and what it was measured on."""
    parts: list[str | Table] = [_machine(result["machine"]), _workload(result["workload"])]
    for name, path in result["paths"].items():
        parts += [
            f"Path '{name}': median ms of a frame's first object, of each further one and of whole"
            " frames, with the 95th percentile and the CPU time of all threads. Decoding the images"
            " is not counted.",
            times_table(path),
        ]
    if len(result["paths"]) > 1:
        parts += [
            "Times relative to the configured path; those of stages are for a frame's first object."
            " Same pose: share of those within {mm:g} mm and {deg:g} degrees of that path's."
            "".format(**result["tolerance"]),
            comparison_table(result),
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


def comparison_table(result: Result) -> Table:
    """A row a path: time relative to the configured path, recall, and agreement with that path."""
    configured = result["paths"][CONFIGURED]
    stages = [part for part in configured["first"] if part.startswith("stage ") or part == TOTAL]
    rows = []
    for name, path in result["paths"].items():
        times = [_ratio(configured["first"][stage], path["first"][stage]) for stage in stages]
        times.append(_ratio(configured["frame"][TOTAL], path["frame"][TOTAL]))
        shares = map(format_share, (path["add_recall"], path["same_pose"]))
        rows.append([name, *times, *shares])
    return Table(["path", *stages, "frame", "ADD(-S)", "same pose"], rows)


def compare_benches(before: Path, after: Path) -> str:
    """Two saved results side by side: median times of each part and their ratio, after/before.

    Only paths that both results have are compared. Raises DataError for a file that is no
    bench, and MissingFileError where there is none.
    """
    first, second = read_bench(before), read_bench(after)
    one, other = first["workload"], second["workload"]
    parts = [
        prose(f"{name}  {path}: {_machine(result['machine'])}", "text")
        for name, path, result in (("A", before, first), ("B", after, second))
    ]
    differing = [
        f"{key} {one.get(key)} and {other.get(key)}"
        for key in dict.fromkeys([*one, *other])
        if one.get(key) != other.get(key)
    ]
    if differing:
        parts.append(prose(f"The two did not measure the same: {'; '.join(differing)}.", "text"))
    for name in first["paths"]:
        if name in second["paths"]:
            table = ratio_table(first["paths"][name], second["paths"][name])
            parts += [f"Path '{name}': median ms of A and B, and B/A.", lay_out(table, "text")]
    peaks = [result["memory"]["peak_mib"] for result in (first, second)]
    return "\n\n".join([*parts, "Peak memory: {:.0f} and {:.0f} MiB.".format(*peaks)])


def ratio_table(first: Result, second: Result) -> Table:
    """A row a part: both medians and their ratio, second/first, of each unit."""
    units = [unit for unit in TIMED if first[unit] and second[unit]]
    rows = []
    for part in [part for part in first["first"] if part in second["first"]]:
        row = [part]
        for unit in units:
            one, other = first[unit][part], second[unit][part]
            row += [*(format_ms(times["median_ms"]) for times in (one, other)), _ratio(one, other)]
        rows.append(row)
    recalls = (format_share(first["add_recall"]), format_share(second["add_recall"]))
    rows.append(["ADD(-S) recall", *recalls, *[""] * (3 * len(units) - 2)])
    return Table(["part", *(name for unit in units for name in (unit, "B", "B/A"))], rows)


def read_bench(path: Path) -> dict[str, Any]:
    """Read bench.json. Raises DataError naming a file that is not one."""
    result: dict[str, Any] = read_json(path)
    missing = {"machine", "workload", "paths", "memory"} - set(result)
    if missing:
        raise DataError(f"{path} is no bench: it lacks {', '.join(sorted(missing))}")
    return result


def _ratio(before: Result, after: Result) -> str:
    """`x1.50`: takes half as long again; empty where there was nothing to divide by."""
    first, second = before["median_ms"], after["median_ms"]
    return f"x{second / first:.2f}" if first else ""


def _machine(machine: Result) -> str:
    return "{cpu}, {cores} cores; threads: {threads}; load before: {load:.2f}".format(**machine)


def _workload(workload: Result) -> str:
    entries = [found["codebook_entries"] for found in workload["objects"].values()]
    few, most = min(entries), max(entries)
    width, height = workload["image"]
    particles = f" with {workload['particles']} particles" if workload["particles"] else ""
    return (
        f"{workload['experiment']}: {workload['frames']} frames of {width} x {height} px,"
        f" {len(entries)} objects, {few if few == most else f'{few}-{most}'} codebook entries each,"
        f" scan {workload['scan']}, codebook {workload['codebook']}, {workload['refinement']}"
        f"{particles}, at most {workload['refined']} hypotheses refined"
    )


def format_ms(value: float) -> str:
    """Milliseconds, with a decimal below 100."""
    return f"{value:.1f}" if value < 100 else f"{value:.0f}"
