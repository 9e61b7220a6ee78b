"""`hlp bench`: measures time and memory of detection, or compares saved measurements."""

from collections.abc import Sequence
from pathlib import Path

from hlp.commands import composing, run
from hlp.errors import HlpError, InputError

COMPARE = "compare="


def command(arguments: Sequence[str]) -> None:
    """Measure, or compare saved results."""
    if composing.HELP & set(arguments):
        print(BENCH_HELP)
        return
    saved = [each.removeprefix(COMPARE) for each in arguments if each.startswith(COMPARE)]
    overrides = [each for each in arguments if not each.startswith(COMPARE)]
    if not saved:
        run.command(["task=bench", *overrides], "bench")
        return
    from hlp.reporting.tables.bench_table import compare_benches

    try:
        if overrides:
            raise InputError(f"compare={saved[-1]} measures nothing: leave {overrides[0]} out")
        before, after = _files(saved[-1])
        print(compare_benches(before, after))
    except HlpError as error:
        composing.fail(error)


def _files(value: str) -> tuple[Path, Path]:
    """The two files of `a.json,b.json` or `[a.json,b.json]`.

    If only one is given, the other is the newest in outputs/.
    """
    names = [each.strip() for each in value.strip("[]").split(",")]
    files = [Path(name).expanduser() for name in names if name]
    if len(files) == 1:
        found = [
            path for path in Path("outputs").rglob("bench.json") if not path.samefile(files[0])
        ]
        files += sorted(found, key=lambda path: path.stat().st_mtime)[-1:]
    if len(files) != 2:
        raise InputError(f"compare={value}: name two bench.json, or one beside those in outputs/")
    return files[0], files[1]


BENCH_HELP = """\
usage: hlp bench [experiment=NAME] [frames=N] [overrides]
       hlp bench compare=A.json
       hlp bench 'compare=[A.json,B.json]'

Measures every stage of detection on the configured data (default: the demo; for
LINEMOD, experiment=linemod_bop data.root=PATH). It reports the median and 95th
percentile of the wall time and of the CPU time of all threads, for the first
object in a frame and for each further one, the time to load a learnt object,
and peak memory. Learnt objects are reused from work, or learnt first. The same
frames are also processed with slower reference settings (task.compared, see
conf/task/bench.yaml), to compare times and poses.

Written into the output folder: bench.json, bench.md, bench.png, bench.svg,
report.html and manifest.json. A sweep ends with a table and a figure of its
runs, which its folder holds as bench.md, bench.csv, bench.png and bench.svg.

hlp bench frames=10 refinement.particles=15            with another setting
hlp bench -m refinement.particles=15,25,50             with each of these values
hlp bench +task.compared.few.refinement.particles=10   compare one more setting

compare=A.json compares a saved bench.json with the newest other one below
outputs/. Two files are compared with each other. Nothing is measured."""
