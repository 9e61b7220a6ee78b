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
AGREEMENT = {"same_pose": "same pose", "same_verdict": "same verdict", "region_iou": "region IoU"}
"""Shares of results that are the same on two paths, and what people call them."""
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
    if result["compared"]:
        parts += [
            "Times relative to the configured path; those of stages are for a frame's first object."
            " Same pose: within {mm:g} mm and {deg:g} degrees; same verdict: right by ADD(-S) in"
            " both or in neither.".format(**result["tolerance"]),
            comparison_table(result),
        ]
    one_by_one = result["paths"][CONFIGURED]["frame"][TOTAL]["median_ms"]
    parts += [
        "A whole frame, its objects searched at once by several threads as by the Python API and"
        " hlp predict: {median_ms:.1f} ms (95 %: {p95_ms:.1f}; CPU {cpu_ms:.1f}); one after"
        " another: ".format(**result["objects_at_once"])
        + f"{one_by_one:.1f} ms",
        *_loading(result),
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
    stages = [*(part for part in configured["first"] if part.startswith("stage ")), TOTAL]
    recall, unknown = format_share(configured["add_recall"]), [""] * len(AGREEMENT)
    rows = [[CONFIGURED, *[""] * (len(stages) + 1), recall, *unknown]]
    for name, compared in result["compared"].items():
        ratio = compared["ratio"]
        times = [*(ratio["first"][stage] for stage in stages), ratio["frame"][TOTAL]]
        recall = format_share(result["paths"][name]["add_recall"])
        agreed = [format_share(compared[key]) for key in AGREEMENT]
        rows.append([name, *map(_times, times), recall, *agreed])
    return Table(["path", *stages, "frame", "ADD(-S)", *AGREEMENT.values()], rows)


def bench_metrics(result: Result) -> dict[str, float | None]:
    """Flat numbers for MLflow, e.g. `bench/configured/first/network`, `bench/configured/add`."""
    flat: dict[str, float | None] = {"bench/peak_mib": result["memory"]["peak_mib"]}
    for name, path in result["paths"].items():
        flat[f"bench/{name}/add"] = path["add_recall"]
        for unit in TIMED:
            for part, spread in path[unit].items():
                flat[f"bench/{name}/{unit}/{part}"] = spread["median_ms"]
    for name, agreed in result["compared"].items():
        flat[f"bench/{name}/same_pose"] = agreed["same_pose"]
    return flat


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
            one, other = (path[unit][part]["median_ms"] for path in (first, second))
            row += [format_ms(one), format_ms(other), _times(other / one if one else None)]
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


def _times(ratio: float | None) -> str:
    """`x1.50`: takes half as long again; empty where there was nothing to divide by."""
    return "" if ratio is None else f"x{ratio:.2f}"


def _machine(machine: Result) -> str:
    threads, versions = machine["threads"], machine["versions"]
    shown = ", ".join(f"{name} {versions[name]}" for name in ("python", "torch", "numba", "numpy"))
    return (
        f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_mib'] / 1024:.0f} GiB,"
        f" {machine['gpu'] or 'no GPU'}; threads: {threads['machine']} (torch {threads['torch']});"
        f" {shown}; load before: {machine['load']:.2f}"
    )


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


def _loading(result: Result) -> list[str]:
    loading, memory = result["loading_s"], result["memory"]
    seconds = [*loading["objects"].values()]
    learnt = f" That includes learning: {', '.join(memory['learnt_too'])}."
    return [
        f"Loading (s): classifier {loading['classifier']:.2f}, encoder {loading['encoder']:.2f},"
        f" each object {sum(seconds) / len(seconds):.2f} (at most {max(seconds):.2f}); reading the"
        f" models of all objects {loading['models']:.2f}, checking what is already learnt"
        f" {loading['finding']:.2f}.",
        f"Peak memory: {memory['peak_mib']:.0f} MiB with all objects loaded,"
        f" {memory['all_paths_mib']:.0f} MiB with every path."
        + (learnt if memory["learnt_too"] else ""),
    ]


def format_ms(value: float) -> str:
    """Milliseconds, with a decimal below 100."""
    return f"{value:.1f}" if value < 100 else f"{value:.0f}"
