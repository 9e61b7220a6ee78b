"""Try each reader for some minutes of CPU time, with seeds that were not tried before.

    python tests/fuzzing/for_minutes.py 10                   # every reader
    python tests/fuzzing/for_minutes.py 10 images learnt.json

Ends with 1 if a reader broke, hung for 20 s, or took 4 GB; its seed belongs into `KEPT` of
test_fuzzed_readers.py.
"""

import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
from readers import Case, readers, try_seed  # noqa: E402

PATIENCE, MEMORY = 20, 4 * 1024**3  # s for a file; bytes beyond those of the start


def _hung(*_: object) -> None:
    raise TimeoutError(f"it takes more than {PATIENCE} s")


def try_reader(name: str, cases: list[Case], seconds: float, folder: Path) -> bool:
    """New seeds until the time is used, or one breaks the reader."""
    begun, first = time.process_time(), time.time_ns() // 1000 % 10**12
    seed = first
    while time.process_time() - begun < seconds:
        folder.mkdir()
        signal.alarm(PATIENCE)
        try:
            try_seed(cases, seed, folder)
        except BaseException as error:
            traceback.print_exc()
            print(f"{name}: seed {seed}, {cases[seed % len(cases)].name}: {error!r:.200}")
            if isinstance(error, KeyboardInterrupt):
                raise
            return False
        finally:
            signal.alarm(0)
            shutil.rmtree(folder)
        seed += 1
    print(f"{name}: {seed - first} files in {seconds:g} s, seeds from {first}", flush=True)
    return True


def main(minutes: float, names: list[str]) -> bool:
    """Whether every reader was clean."""
    signal.signal(signal.SIGALRM, _hung)
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, most))
    with tempfile.TemporaryDirectory() as made:
        valid = Path(made, "valid")
        valid.mkdir()
        found, folder = readers(valid), Path(made, "tried")
        return all([try_reader(n, found[n], 60 * minutes, folder) for n in names or found])


if __name__ == "__main__":
    sys.exit(not main(float(sys.argv[1]), sys.argv[2:]))
