"""Try each kind of file for some minutes of CPU time, with new examples in every round.

    python tests/fuzzing/for_minutes.py 10           # every kind
    python tests/fuzzing/for_minutes.py 10 obj stl   # these

Prints how many examples were tried; ends with 1 if one of them broke a test. What a round finds is
in pytest's own output, with the blob that repeats it, and belongs into the test as an `@example`.
"""

import os
import resource
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
FRAMES = HERE / "test_fuzzed_frames.py"
MESHES = HERE / "test_fuzzed_meshes.py"
RESULTS = HERE / "test_fuzzed_results.py"
KINDS: dict[str, tuple[Path, str, int]] = {
    "bop": (FRAMES, "scenes or masks or targets or models_info or names", 7),
    "intrinsics": (FRAMES, "test_intrinsics and not found", 8),
    "dpt": (FRAMES, "dpt", 2),
    "rot": (FRAMES, "rot0", 1),
    "tra": (FRAMES, "tra0 or 0000", 2),
    "ply": (MESHES, "test_meshes and ply", 2),
    "obj": (MESHES, "test_meshes and obj or materials", 2),
    "stl": (MESHES, "test_meshes and stl", 2),
    "off-glb": (MESHES, "test_meshes and (off or glb)", 2),
    "tables": (RESULTS, "csv and not damaged", 3),
    "records": (RESULTS, "(json or records or overrides) and not damaged", 10),
}
"""File, pytest's `-k`, and the number of tests with random examples that it chooses."""
FIRST_ROUND = 200  # examples of each test, to learn how long they take
LONGEST_ROUND = 20_000


def cpu_seconds() -> float:
    """CPU time of the child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def try_kind(kind: str, seconds: float) -> bool:
    """Rounds of examples until the time is used, or one fails."""
    path, chosen, tests = KINDS[kind]
    begun, tried, examples = cpu_seconds(), 0, FIRST_ROUND
    while (used := cpu_seconds() - begun) < seconds:
        if tried:
            rate = tried / used
            examples = int(min(max((seconds - used) * rate / tests, FIRST_ROUND), LONGEST_ROUND))
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-x", str(path)]
        environment = {**os.environ, "HLP_EXAMPLES": str(examples), "OMP_NUM_THREADS": "1"}
        done = subprocess.run([*command, "-k", chosen], env=environment, check=False)
        if done.returncode != 0:
            print(f"{kind}: broken after {tried} examples or fewer than {examples} more")
            return False
        tried += examples * tests
    print(
        f"{kind}: {tried} examples in {used / 60:.1f} minutes of CPU time, none broke", flush=True
    )
    return True


if __name__ == "__main__":
    minutes, *kinds = sys.argv[1:]
    sys.exit(not all([try_kind(kind, 60 * float(minutes)) for kind in kinds or KINDS]))
