"""`hlp bench`: time and memory of detection's stages, and saved results beside each other."""

from collections.abc import Sequence
from pathlib import Path

from hlp.commands import composing, run

COMPARE = "compare="


def command(arguments: Sequence[str]) -> None:
    """Measure, or put saved results side by side."""
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
            raise ValueError(f"compare={saved[-1]} measures nothing: leave {overrides[0]} out")
        before, after = _files(saved[-1])
        print(compare_benches(before, after))
    except (ValueError, OSError) as error:
        composing.fail(error)


def _files(value: str) -> tuple[Path, Path]:
    """The two files of `a.json,b.json` or `[a.json,b.json]`; of one, the newest is the other."""
    names = [each.strip() for each in value.strip("[]").split(",")]
    files = [Path(name).expanduser() for name in names if name]
    if len(files) == 1:
        found = [
            path for path in Path("outputs").rglob("bench.json") if not path.samefile(files[0])
        ]
        files += sorted(found, key=lambda path: path.stat().st_mtime)[-1:]
    if len(files) != 2:
        raise ValueError(f"compare={value}: name two bench.json, or one beside those in outputs/")
    return files[0], files[1]


BENCH_HELP = """\
usage: hlp bench [experiment=NAME] [frames=N] [overrides]
       hlp bench compare=A.json
       hlp bench 'compare=[A.json,B.json]'

Times every stage of detection on the configured data (the demo's; linemod_bop: experiment=linemod_bop
data.root=PATH), frame by frame: median and 95th percentile of wall time, CPU time of all threads,
for the first object looked for in a frame and for each further one; loading a trained object; peak
memory. What is learnt is reused from work, or made first. The same frames go through slower
reference paths in the same run (task.compared, see conf/task/bench.yaml): how many times as long,
and whether their poses are the same.

Written into the output folder: bench.json, bench.md and manifest.json.

hlp bench frames=10 refinement.particles=15            another setting
hlp bench -m refinement.particles=15,25,50             each of several
hlp bench +task.compared.few.refinement.particles=10   one more path through the same frames

compare=A.json puts the newest other bench.json below outputs/ beside a saved one; two files are
compared with each other. It measures nothing."""
