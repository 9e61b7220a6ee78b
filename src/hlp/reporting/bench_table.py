"""A bench's result as tables, and two saved results beside each other."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hlp.reporting.tables import FORMATS, Table

OWN = "configured"
"""The path that the configuration itself describes, which the others are compared with."""
VIEWS = {"first": "first object", "further": "each further", "frame": "whole frame"}
"""What the times of a path are of, and what people call it."""
AGREEMENT = {
    "same_pose": "same pose",
    "same_verdict": "same verdict",
    "region_iou": "region IoU",
}
"""How far two paths say the same, as shares, and what people call it."""
TOTAL = "total"
Result = Mapping[str, Any]


def format_bench(result: Result, layout: str = "text") -> str:
    """Every table of a bench (`text` or `markdown`), and what it was measured on."""
    table = FORMATS[layout]
    parts = [_machine_words(result["machine"]), _workload_words(result["workload"])]
    for name, path in result["paths"].items():
        heading = f"Path '{name}': ms, decoding the images not counted; CPU of all threads."
        parts += [heading, table(times_table(path)), table(objects_table(path))]
    if result["compared"]:
        parts += [_comparison_words(result["tolerance"]), table(comparison_table(result))]
    if result["search"] is not None:
        parts.append(_search_words(result["search"]))
    parts += [_regions_words(result["regions_of_all"]), _loading_words(result)]
    return "\n\n".join(parts)


def times_table(path: Result) -> Table:
    """A row a part, stage and in all; median, 95th percentile and CPU time of each view."""
    views = [view for view in VIEWS if path[view]]
    header = [name for view in views for name in (VIEWS[view], "95 %", "CPU")]
    rows = []
    for part in path["first"]:
        cells = [path[view][part] for view in views]
        numbers = [_ms(cell[key]) for cell in cells for key in ("median_ms", "p95_ms", "cpu_ms")]
        rows.append([part, *numbers])
    return Table(["part", *header], rows)


def objects_table(path: Result) -> Table:
    """Median time of a frame by the number of objects looked for in it."""
    rows = [
        [count, str(each["frames"]), _ms(each["median_ms"])]
        for count, each in path["by_objects"].items()
    ]
    return Table(["objects", "frames", "ms"], rows)


def comparison_table(result: Result) -> Table:
    """A row a path: how many times as long as the configured one, recall, and what agrees."""
    own, stages = result["paths"][OWN], [*_stages(result), TOTAL]
    rows = [[OWN, *[""] * (len(stages) + 1), _share(own["add_recall"]), *[""] * len(AGREEMENT)]]
    for name, compared in result["compared"].items():
        times = [_times(compared["ratio"]["first"][stage]) for stage in stages]
        whole = _times(compared["ratio"]["frame"][TOTAL])
        recall = _share(result["paths"][name]["add_recall"])
        rows.append([name, *times, whole, recall, *(_share(compared[key]) for key in AGREEMENT)])
    header = [*stages, VIEWS["frame"], "AD", *AGREEMENT.values()]
    return Table(["path", *header], rows)


def write_bench(folder: Path, result: Result) -> None:
    """Write bench.md."""
    text = format_bench(result, "markdown")
    (folder / "bench.md").write_text(text + "\n", encoding="utf-8")


def bench_metrics(result: Result) -> dict[str, float | None]:
    """Flat numbers for MLflow, e.g. `bench/configured/first/network`, `bench/configured/add`."""
    flat: dict[str, float | None] = {"bench/peak_mib": result["memory"]["peak_mib"]}
    for name, path in result["paths"].items():
        flat[f"bench/{name}/add"] = path["add_recall"]
        for view in VIEWS:
            for part, spread in path[view].items():
                flat[f"bench/{name}/{view}/{part}"] = spread["median_ms"]
    for name, agreed in result["compared"].items():
        flat[f"bench/{name}/same_pose"] = agreed["same_pose"]
    return flat


def compare(before: Path, after: Path) -> str:
    """Two saved results: every part's median in both and after/before, of paths that both have.

    Raises ValueError for a file that is no bench, and OSError for one that cannot be read.
    """
    first, second = read_bench(before), read_bench(after)
    parts = [f"A  {before}: {_machine_words(first['machine'])}"]
    parts += [f"B  {after}: {_machine_words(second['machine'])}"]
    differing = _differing(first["workload"], second["workload"])
    if differing:
        parts.append(f"Not the same was measured: {'; '.join(differing)}.")
    for name in first["paths"]:
        if name in second["paths"]:
            table = ratio_table(first["paths"][name], second["paths"][name])
            parts += [f"Path '{name}': median ms of A and B, and B/A.", table.text()]
    peaks = [each["memory"]["peak_mib"] for each in (first, second)]
    parts.append(f"Peak memory: {peaks[0]:.0f} and {peaks[1]:.0f} MiB.")
    return "\n\n".join(parts)


def ratio_table(first: Result, second: Result) -> Table:
    """A row a part; of each view both medians and how many times as long the second takes."""
    views = [view for view in VIEWS if first[view] and second[view]]
    header = [name for view in views for name in (VIEWS[view], "B", "B/A")]
    rows = []
    for part in [each for each in first["first"] if each in second["first"]]:
        cells = []
        for view in views:
            one, other = (each[view][part]["median_ms"] for each in (first, second))
            cells += [_ms(one), _ms(other), _times(other / one if one else None)]
        rows.append([part, *cells])
    recalls = (_share(first["add_recall"]), _share(second["add_recall"]))
    rows.append(["AD recall", *recalls, *[""] * (3 * len(views) - 2)])
    return Table(["part", *header], rows)


def read_bench(path: Path) -> dict[str, Any]:
    """Read bench.json; raises ValueError naming the file where it is none."""
    try:
        result: dict[str, Any] = json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(f"{path} is no JSON: {error}") from error
    missing = {"machine", "workload", "paths", "memory"} - set(result)
    if missing:
        raise ValueError(f"{path} is no bench: it lacks {', '.join(sorted(missing))}")
    return result


def _differing(first: Result, second: Result) -> list[str]:
    keys = dict.fromkeys([*first, *second])
    return [
        f"{key} {first.get(key)} and {second.get(key)}"
        for key in keys
        if first.get(key) != second.get(key)
    ]


def _stages(result: Result) -> list[str]:
    return [name for name in result["paths"][OWN]["first"] if name.startswith("stage ")]


def _times(ratio: float | None) -> str:
    """`x1.50`: takes half as long again; empty where there was nothing to divide by."""
    return "" if ratio is None else f"x{ratio:.2f}"


def _machine_words(machine: Result) -> str:
    threads = machine["threads"]
    versions = machine["versions"]
    shown = ", ".join(f"{name} {versions[name]}" for name in ("python", "torch", "numba", "numpy"))
    gpu = machine["gpu"] or "no GPU"
    return (
        f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_mib'] / 1024:.0f} GiB,"
        f" {gpu}; threads: {threads['machine']} (torch {threads['torch']}); {shown};"
        f" load before: {machine['load']:.2f}"
    )


def _workload_words(workload: Result) -> str:
    objects = workload["objects"]
    entries = [each["codebook_entries"] for each in objects.values()]
    width, height = workload["image"]
    particles = workload["particles"]
    return (
        f"{workload['experiment']}: {workload['frames']} frames of {width} x {height} px,"
        f" {len(objects)} objects, {min(entries)}-{max(entries)} codebook entries each,"
        f" scan {workload['scan']}, codebook {workload['codebook']}, {workload['refinement']}"
        + (f" with {particles} particles" if particles else "")
        + f", at most {workload['refined']} hypotheses refined"
    )


def _comparison_words(tolerance: Result) -> str:
    return (
        "How many times as long as the configured path, stages for the first object in a frame."
        f" Same pose: within {tolerance['mm']:g} mm and {tolerance['deg']:g} degrees; same verdict:"
        " right by AD in both or in neither."
    )


def _search_words(search: Result) -> str:
    return (
        f"Codebook search beside the exact one, on the same {search['queries']:.0f} queries"
        f" (median): recall {search['recall']:.3f}, of the nearest"
        f" {search['recall_of_nearest']:.3f}; {search['median_ms']:.1f} ms and"
        f" {search['exact_ms']:.1f} ms, x{search['ratio']:.1f}"
    )


def _regions_words(regions: Result) -> str:
    times = (regions["median_ms"], regions["p95_ms"], regions["cpu_ms"])
    return (
        f"Stage 1 for all {regions['objects']} objects that the classifier knows, in one frame:"
        " {:.1f} ms (95 %: {:.1f}; CPU {:.1f})".format(*times)
    )


def _loading_words(result: Result) -> str:
    loading, memory = result["loading_s"], result["memory"]
    seconds = list(loading["objects"].values())
    learnt = memory["learnt_too"]
    return (
        f"Loading (s): classifier {loading['classifier']:.2f}, encoder {loading['encoder']:.2f},"
        f" each object {sum(seconds) / len(seconds):.2f} (at most {max(seconds):.2f}); reading the"
        f" models of all objects {loading['models']:.2f}, finding what was learnt"
        f" {loading['finding']:.2f}.\nPeak memory: {memory['peak_mib']:.0f} MiB with all objects"
        f" loaded, {memory['all_paths_mib']:.0f} MiB with every path."
        + (f" Learning counts in it: {', '.join(learnt)}." if learnt else "")
    )


def _ms(value: float) -> str:
    return f"{value:.1f}" if value < 100 else f"{value:.0f}"


def _share(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"
