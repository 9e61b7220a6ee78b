"""`hlp run`, `hlp bench` and `hlp search`: run the task of a configuration.

Once, as a sweep, or again from a manifest.
"""

import tempfile
import textwrap
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from hlp.commands import MULTIRUN, composing
from hlp.config.composition import chosen_by_hydra, provide_defaults
from hlp.errors import InputError
from hlp.files import expanded
from hlp.studies import sweep

_MANIFEST, _COMPARE, _SPACE = "manifest=", "compare=", "space="


def run(arguments: Sequence[str], name: str = "run") -> None:
    """Compose the configuration, build what it names, and run its task."""
    if any(argument.startswith(_MANIFEST) for argument in arguments):
        _repeat(arguments)
        return
    if MULTIRUN & {*arguments} and (folder := sweep.unfinished_sweep(arguments, Path("outputs"))):
        print(f"continuing the sweep in {folder}")
        arguments = [*arguments, f"output='{folder}'"]
    composing.compose_and_call(name, arguments, _run)


def bench(arguments: Sequence[str]) -> None:
    """Measure time and memory of detection, or compare saved measurements."""
    saved = [word.removeprefix(_COMPARE) for word in arguments if word.startswith(_COMPARE)]
    overrides = [word for word in arguments if not word.startswith(_COMPARE)]
    if not saved:
        run(["task=bench", *overrides], "bench")
        return
    from hlp.reporting.study_tables import compare_benches

    if overrides:
        raise InputError(f"compare={saved[-1]} measures nothing: leave {overrides[0]} out")
    print(compare_benches(*_bench_files(saved[-1])))


def search(arguments: Sequence[str]) -> None:
    """Search a named space for the settings with the best recall, or continue its search."""
    overrides = [f"task/{word}" if word.startswith(_SPACE) else word for word in arguments]
    run(["task=search", *overrides], "search")


def _run(config: DictConfig, manifest: Path | None = None) -> None:
    """Build what the composed configuration names, and run its task.

    With a `manifest`, the configuration comes from it, and data and poses are compared with it.
    """
    # What only shows the configuration waits for none of these.
    from hlp.config import build
    from hlp.runs.manifest import run_again

    if config.output != "":  # otherwise the settings say that it is empty
        config.output = HydraConfig.get().runtime.output_dir  # each run of a sweep has its own
    if HydraConfig.get().mode == RunMode.MULTIRUN:
        sweep.run_one(config)
        return
    built = build.build_run(config, chosen_by_hydra())
    if manifest is None:
        built.settings.task.run(built, Path(config.output))
    else:
        run_again(built, manifest, Path(config.output))


def _repeat(arguments: Sequence[str]) -> None:
    from hlp.runs.manifest import config_of

    overrides = [word for word in arguments if not word.startswith(_MANIFEST)]
    named = [word.removeprefix(_MANIFEST) for word in arguments if word.startswith(_MANIFEST)]
    manifest = expanded(named[-1])
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "config.yaml").write_text(config_of(manifest, overrides))
        composing.compose_and_call("run", overrides, partial(_run, manifest=manifest), Path(folder))


def _bench_files(value: str) -> tuple[Path, Path]:
    """The two files of `a.json,b.json` or `[a.json,b.json]`.

    If only one is given, the other is the newest in outputs/.
    """
    names = [name.strip() for name in value.strip("[]").split(",")]
    files = [expanded(name) for name in names if name]
    if len(files) == 1:
        found = sorted(Path("outputs").rglob("bench.json"), key=lambda path: path.stat().st_mtime)
        files += [path for path in found if not path.samefile(files[0])][-1:]
    if len(files) != 2:
        raise InputError(f"compare={value}: name two bench.json, or one beside those in outputs/")
    return files[0], files[1]


def filled(text: str) -> str:
    """The help with the groups, also those within others, and their alternatives."""
    provide_defaults()
    with initialize_config_dir(str(composing.config_folder().absolute()), version_base="1.3"):
        return text.format(groups="\n".join(_groups()))


def _groups() -> Iterator[str]:
    loader = GlobalHydra.instance().config_loader()
    groups = loader.list_groups("")
    while groups:
        group = groups.pop(0)
        groups[:0] = [f"{group}/{inner}" for inner in loader.list_groups(group)]
        names = loader.get_group_options(group)
        if names and not group.startswith("hydra"):
            yield textwrap.fill(
                f"{group}: {', '.join(names)}", 80, subsequent_indent="    ", break_on_hyphens=False
            )
