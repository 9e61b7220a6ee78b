"""Try each kind of file for some minutes of CPU time, with new examples in every round.

    python tests/fuzzing/for_minutes.py 10                   # every kind
    python tests/fuzzing/for_minutes.py 10 meshes results    # these

Ends with 1 if an example broke a test. What a round finds is in pytest's own output, with the blob
that repeats it, and belongs into the test as an `@example`.
"""

import os
import resource
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
KINDS = ("frames", "meshes", "results")
EXAMPLES = "1000"  # of each test in a round


def cpu_seconds() -> float:
    """CPU time of the child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def try_kind(kind: str, seconds: float) -> bool:
    """Rounds of examples until the time is used, or one fails."""
    begun, file = cpu_seconds(), str(HERE / f"test_fuzzed_{kind}.py")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-x", file]
    environment = {**os.environ, "HLP_EXAMPLES": EXAMPLES, "OMP_NUM_THREADS": "1"}
    while cpu_seconds() - begun < seconds:
        if subprocess.run(command, env=environment, check=False).returncode != 0:
            return False
    return True


if __name__ == "__main__":
    minutes, *kinds = sys.argv[1:]
    sys.exit(not all([try_kind(kind, 60 * float(minutes)) for kind in kinds or KINDS]))
