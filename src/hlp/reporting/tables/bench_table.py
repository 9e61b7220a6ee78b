"""Results of a bench as tables, and two saved results side by side."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hlp.errors import DataError
from hlp.files import read_json, write_text
from hlp.reporting.tables.table import Table, format_share, lay_out, prose

CONFIGURED = "configured"
"""Name of the path that the configuration itself describes; the others are compared with it."""
TIMED = {"first": "first", "further": "further", "frame": "frame"}
"""Units that are timed, and what people call them."""
AGREEMENT = {
    "same_pose": "same pose",
    "same_verdict": "same verdict",
    "region_iou": "region IoU",
}
"""Shares of results that are the same on two paths, and what people call them."""
TOTAL = "total"
Result = Mapping[str, Any]


def format_bench(result: Result, layout: str = "text") -> str:
    """All tables of a bench (`text` or `markdown`), and what it was measured on."""
    words = [_describe_machine(result["machine"]), _describe_workload(result["workload"])]
    parts = [prose(each, layout) for each in words]
    for name, path in result["paths"].items():
        heading = (
            f"Path '{name}': median ms of a frame's first object, of each further one and of whole"
            " frames, with the 95th percentile and the CPU time of all threads. Decoding the"
            " images is not counted."
        )
        parts += [prose(heading, layout), lay_out(times_table(path), layout)]
        parts += [prose("By the objects of a frame:", layout), lay_out(objects_table(path), layout)]
    if result["compared"]:
        parts.append(prose(_describe_comparison(result["tolerance"]), layout))
        parts.append(lay_out(comparison_table(result), layout))
    words = [] if result["search"] is None else [_describe_search(result["search"])]
    words += [_describe_at_once(result), _describe_regions(result["regions_of_all"])]
    return "\n\n".join(
        [*parts, *(prose(each, layout) for each in (*words, _describe_loading(result)))]
    )


def times_table(path: Result) -> Table:
    """A row a part and stage, and the total: median, 95th percentile and CPU time of each unit."""
    units = [unit for unit in TIMED if path[unit]]
    header = [name for unit in units for name in (TIMED[unit], "95 %", "CPU")]
    rows = []
    for part in path["first"]:
        cells = [path[unit][part] for unit in units]
        numbers = [
            format_ms(cell[key]) for cell in cells for key in ("median_ms", "p95_ms", "cpu_ms")
        ]
        rows.append([part, *numbers])
    return Table(["part", *header], rows)


def objects_table(path: Result) -> Table:
    """Median time of a frame, by the number of objects looked for in it."""
    rows = [
        [count, str(each["frames"]), format_ms(each["median_ms"])]
        for count, each in path["by_objects"].items()
    ]
    return Table(["objects", "frames", "ms"], rows)


def comparison_table(result: Result) -> Table:
    """A row a path: time relative to the configured path, recall, and agreement with that path."""
    configured, stages = result["paths"][CONFIGURED], [*_stages(result), TOTAL]
    rows = [
        [
            CONFIGURED,
            *[""] * (len(stages) + 1),
            format_share(configured["add_recall"]),
            *[""] * len(AGREEMENT),
        ]
    ]
    for name, compared in result["compared"].items():
        times = [_times(compared["ratio"]["first"][stage]) for stage in stages]
        whole = _times(compared["ratio"]["frame"][TOTAL])
        recall = format_share(result["paths"][name]["add_recall"])
        rows.append(
            [name, *times, whole, recall, *(format_share(compared[key]) for key in AGREEMENT)]
        )
    header = [*stages, TIMED["frame"], "ADD(-S)", *AGREEMENT.values()]
    return Table(["path", *header], rows)


def write_bench(folder: Path, result: Result) -> None:
    """Write bench.md."""
    write_text(folder / "bench.md", format_bench(result, "markdown") + "\n")


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
    parts = [prose(f"A  {before}: {_describe_machine(first['machine'])}", "text")]
    parts += [prose(f"B  {after}: {_describe_machine(second['machine'])}", "text")]
    differing = _differing(first["workload"], second["workload"])
    if differing:
        words = f"The two did not measure the same: {'; '.join(differing)}."
        parts.append(prose(words, "text"))
    for name in first["paths"]:
        if name in second["paths"]:
            table = ratio_table(first["paths"][name], second["paths"][name])
            parts += [f"Path '{name}': median ms of A and B, and B/A.", lay_out(table, "text")]
    peaks = [each["memory"]["peak_mib"] for each in (first, second)]
    parts.append(f"Peak memory: {peaks[0]:.0f} and {peaks[1]:.0f} MiB.")
    return "\n\n".join(parts)


def ratio_table(first: Result, second: Result) -> Table:
    """A row a part: both medians and their ratio, second/first, of each unit."""
    units = [unit for unit in TIMED if first[unit] and second[unit]]
    header = [name for unit in units for name in (TIMED[unit], "B", "B/A")]
    rows = []
    for part in [each for each in first["first"] if each in second["first"]]:
        cells = []
        for unit in units:
            one, other = (each[unit][part]["median_ms"] for each in (first, second))
            cells += [format_ms(one), format_ms(other), _times(other / one if one else None)]
        rows.append([part, *cells])
    recalls = (format_share(first["add_recall"]), format_share(second["add_recall"]))
    rows.append(["ADD(-S) recall", *recalls, *[""] * (3 * len(units) - 2)])
    return Table(["part", *header], rows)


def read_bench(path: Path) -> dict[str, Any]:
    """Read bench.json. Raises DataError naming a file that is not one."""
    result: dict[str, Any] = read_json(path)
    missing = {"machine", "workload", "paths", "memory"} - set(result)
    if missing:
        raise DataError(f"{path} is no bench: it lacks {', '.join(sorted(missing))}")
    return result


def _differing(first: Result, second: Result) -> list[str]:
    keys = dict.fromkeys([*first, *second])
    return [
        f"{key} {first.get(key)} and {second.get(key)}"
        for key in keys
        if first.get(key) != second.get(key)
    ]


def _stages(result: Result) -> list[str]:
    return [name for name in result["paths"][CONFIGURED]["first"] if name.startswith("stage ")]


def _times(ratio: float | None) -> str:
    """`x1.50`: takes half as long again; empty where there was nothing to divide by."""
    return "" if ratio is None else f"x{ratio:.2f}"


def _describe_machine(machine: Result) -> str:
    threads = machine["threads"]
    versions = machine["versions"]
    shown = ", ".join(f"{name} {versions[name]}" for name in ("python", "torch", "numba", "numpy"))
    gpu = machine["gpu"] or "no GPU"
    return (
        f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_mib'] / 1024:.0f} GiB,"
        f" {gpu}; threads: {threads['machine']} (torch {threads['torch']}); {shown};"
        f" load before: {machine['load']:.2f}"
    )


def _describe_workload(workload: Result) -> str:
    objects = workload["objects"]
    entries = [each["codebook_entries"] for each in objects.values()]
    few, most = min(entries), max(entries)
    width, height = workload["image"]
    particles = workload["particles"]
    return (
        f"{workload['experiment']}: {workload['frames']} frames of {width} x {height} px,"
        f" {len(objects)} objects, {few if few == most else f'{few}-{most}'} codebook entries each,"
        f" scan {workload['scan']}, codebook {workload['codebook']}, {workload['refinement']}"
        + (f" with {particles} particles" if particles else "")
        + f", at most {workload['refined']} hypotheses refined"
    )


def _describe_comparison(tolerance: Result) -> str:
    return (
        "Times relative to the configured path; those of stages are for a frame's first object."
        f" Same pose: within {tolerance['mm']:g} mm and {tolerance['deg']:g} degrees; same verdict:"
        " right by ADD(-S) in both or in neither."
    )


def _describe_search(search: Result) -> str:
    return (
        f"Codebook search beside the exact one, on the same {search['queries']:.0f} queries"
        f" (median): recall {search['recall']:.3f}, of the nearest"
        f" {search['recall_of_nearest']:.3f}; {search['median_ms']:.1f} ms and"
        f" {search['exact_ms']:.1f} ms, x{search['ratio']:.1f}"
    )


def _describe_at_once(result: Result) -> str:
    one_by_one = result["paths"][CONFIGURED]["frame"][TOTAL]["median_ms"]
    found = result["objects_at_once"]
    times = (found["median_ms"], found["p95_ms"], found["cpu_ms"], one_by_one)
    return (
        "A whole frame, its objects searched at once by several threads as by the Python API and"
        " hlp predict: {:.1f} ms (95 %: {:.1f}; CPU {:.1f}); one after another: {:.1f} ms".format(
            *times
        )
    )


def _describe_regions(regions: Result) -> str:
    times = (regions["median_ms"], regions["p95_ms"], regions["cpu_ms"])
    return (
        f"Stage 1 for all {regions['objects']} objects that the classifier knows, in one frame:"
        " {:.1f} ms (95 %: {:.1f}; CPU {:.1f})".format(*times)
    )


def _describe_loading(result: Result) -> str:
    loading, memory = result["loading_s"], result["memory"]
    seconds = list(loading["objects"].values())
    learnt = memory["learnt_too"]
    return (
        f"Loading (s): classifier {loading['classifier']:.2f}, encoder {loading['encoder']:.2f},"
        f" each object {sum(seconds) / len(seconds):.2f} (at most {max(seconds):.2f}); reading the"
        f" models of all objects {loading['models']:.2f}, checking what is already"
        f" learnt {loading['finding']:.2f}.\nPeak memory: {memory['peak_mib']:.0f} MiB with all"
        f" objects loaded, {memory['all_paths_mib']:.0f} MiB with every path."
        + (f" That includes learning: {', '.join(learnt)}." if learnt else "")
    )


def format_ms(value: float) -> str:
    """Milliseconds, with a decimal below 100."""
    return f"{value:.1f}" if value < 100 else f"{value:.0f}"
