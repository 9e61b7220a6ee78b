"""Short names of runs, which begin with what differs."""

from collections.abc import Collection, Mapping

_LONGEST = 48  # characters; MLflow's columns cut longer ones off
# They change no pose, or are shown elsewhere.
_UNNAMED = {"data.root", "data_folder", "panels", "timing_frames", "on_bad_frame"}
_UNNAMED_GROUPS = ("reporting", "machine", "executor")


def short_name(values: Mapping[str, str], groups: Collection[str], otherwise: str) -> str:
    """Values in words: `icp, particles 25, seed 1`; of a group, its alternative alone.

    `otherwise` where there are none.
    """
    words = []
    for key, value in values.items():
        if key in _UNNAMED or key.partition(".")[0] in _UNNAMED_GROUPS:
            continue
        last = key.rpartition(".")[2].rpartition("/")[2]
        words.append(value if key in groups else f"{last} {value}")
    name = ", ".join(words) or otherwise
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"
