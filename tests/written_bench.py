"""What a bench has found, as it is in bench.json."""

from typing import Any


def spreads(scale: float) -> dict[str, dict[str, float]]:
    times = {"network": 10.0, "stage 1": 10.0, "total": 10.0}
    return {
        part: {"median_ms": ms * scale, "p95_ms": 2 * ms * scale, "cpu_ms": 1.5 * ms * scale}
        for part, ms in times.items()
    }


def bench_path(scale: float, recall: float) -> dict[str, Any]:
    views = {"first": spreads(scale), "further": spreads(scale / 4), "frame": spreads(2 * scale)}
    return {"add_recall": recall, "same_pose": recall, **views}


def bench_result() -> dict[str, Any]:
    """The configured path and one that takes three times as long."""
    return {
        "machine": {"cpu": "Quick 9000", "cores": 2, "threads": 2, "load": 0.1},
        "workload": {
            "experiment": "demo",
            "frames": 3,
            "image": "640 x 480",
            "objects": 1,
            "codebook_entries": 57600,
            "scan": "fast",
            "codebook": "inverted_lists",
            "refinement": "pso",
            "particles": 25,
            "refined": 8,
        },
        "loading_s": {"classifier": 0.1, "encoder": 0.1, "objects": {"cat": 0.4}},
        "memory": {"peak_mib": 900.0},
        "paths": {"configured": bench_path(1.0, 0.8), "reference": bench_path(3.0, 0.7)},
        "tolerance": {"mm": 1.0, "deg": 0.5},
    }
