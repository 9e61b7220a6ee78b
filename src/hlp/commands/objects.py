"""`hlp objects`: what is learnt and kept in the user's cache."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from hlp.commands import composing, own_arguments
from hlp.commands.nearest import nearest
from hlp.commands.tracking_uri import tracking_uri
from hlp.errors import InputError

_WORDS = ("list", "show", "remove", "export", "register")


def command(arguments: Sequence[str]) -> None:
    """List, show, remove or export entries of the cache."""
    if not arguments or composing.HELP & set(arguments):
        print(OBJECTS_HELP)
        return
    own_arguments.call(lambda: _do(arguments))


def _do(arguments: Sequence[str]) -> None:
    from hlp.runs import learnt_cache

    words = [each for each in arguments if not each.startswith(("work=", "uri="))]
    uri = next((each[4:] for each in arguments if each.startswith("uri=")), tracking_uri())
    work = next((each[5:] for each in arguments if each.startswith("work=")), None)
    cache = learnt_cache.cache_folder(work)
    match words:
        case ["list"]:
            print(_listed(cache))
        case ["show", name]:
            print(_shown(learnt_cache.find_learnt(name, cache)))
        case ["remove", name]:
            print(f"removed {learnt_cache.remove_learnt(name, cache)}")
        case ["export", name, target]:
            with _whole(name, cache, work) as folder:
                made = learnt_cache.export_learnt(str(folder), Path(target).expanduser(), cache)
            print(f"copied to {made}")
        case ["register", name, model]:
            with _whole(name, cache, work) as folder:
                print(_registered(folder, model, uri))
        case _:
            word = words[0] if words else ""
            hint = nearest(word, _WORDS) if word not in _WORDS else ""
            lines = OBJECTS_HELP.split("\n")
            ask = next(
                (line[7:] for line in lines if f" objects {word} " in line), "hlp objects --help"
            )
            raise InputError(f"cannot use '{' '.join(words)}'{hint or ':'} see `{ask}`")


@contextmanager
def _whole(given: str, cache: Path, work: str | None) -> Iterator[Path]:
    """An undamaged folder of learnt objects: one by path or name, or of what a run has learnt."""
    from hlp.files import MANIFEST
    from hlp.runs.learnt_cache import find_whole

    manifest = Path(given).expanduser() / MANIFEST
    if not manifest.is_file():
        yield find_whole(given, cache)
        return
    with tempfile.TemporaryDirectory() as folder:
        _take_from_run(manifest, work or "work", Path(folder, "learnt"))
        yield Path(folder, "learnt")


def _take_from_run(manifest: Path, work: str, target: Path) -> None:
    from hlp.config.build import build_run
    from hlp.runs.learning import learnt_of_run
    from hlp.studies.repeat import check_manifest, config_of

    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "config.yaml").write_text(config_of(manifest, (), composing.config_folder()))
        places = (f"work='{work}'", "output=none")
        run = build_run(composing.compose_config(*places, folder=Path(folder)))
    check_manifest(run, manifest)
    learnt_of_run(run, manifest, target)


def _registered(folder: Path, model: str, uri: str) -> str:
    from hlp.runs.mlflow_log import register_learnt

    address = register_learnt(folder, model, uri)
    return f"registered {address}; in Python: mlflow.pyfunc.load_model('{address}')"


def _listed(cache: Path) -> str:
    from hlp.runs.learnt_cache import list_learnt

    entries = list_learnt(cache)
    if not entries:
        return f"nothing is learnt yet in {cache}: hlp learn mesh=FILE"
    lines = [
        f"{each.name:<28} {each.size / 1e6:6.0f} MB  {each.problem or ', '.join(each.objects)}"
        for each in entries
    ]
    return "\n".join([*lines, f"in {cache}"])


def _shown(folder: Path) -> str:
    from hlp.method.learn.learnt_folder import LearntFolder
    from hlp.runs.learnt_cache import describe_learnt

    entry = describe_learnt(folder)
    lines = [f"{folder}: {entry.size / 1e6:.0f} MB"]
    learnt = LearntFolder(folder)
    local = learnt.settings.patches.local
    for model in learnt.models.values():
        low, high = model.mesh.vertices.min(axis=0), model.mesh.vertices.max(axis=0)
        size = " × ".join(f"{side * 1000:.0f}" for side in high - low)
        color = "texture" if model.mesh.texture is not None else "colours"
        lines += [
            f"{model.name} (id {model.object_id})",
            f"  size        {size} mm, diameter {model.diameter * 1000:.0f} mm",
            f"  mesh        {len(model.mesh.faces)} triangles, {len(model.proxy.faces)} to refine; "
            f"{color if model.mesh.colored else 'no colours'}",
            f"  symmetries  {len(model.symmetries) - 1}; {len(model.siblings)} more that only "
            "colours tell apart",
            f"  patches     windows {model.holistic_size * 1000:.0f} mm, "
            f"local {local.side_of(model.local_size) * 1000:.0f} mm",
        ]
    return "\n".join(lines)


OBJECTS_HELP = """\
usage: hlp objects list
       hlp objects show NAME|FOLDER
       hlp objects remove NAME
       hlp objects export NAME|RUN FOLDER
       hlp objects register NAME|FOLDER|RUN MODEL [uri=MLFLOW]

What `hlp learn` and `hlp predict model=…` have learnt and keep in the user's
cache.

  list     names, sizes on disk and objects
  show     size, symmetries, colours and patch sizes of the objects
  remove   delete an entry
  export   copy it into a new folder, to be used on another machine: hlp predict
           learnt=FOLDER …
  register copy it into MLflow as a new version of MODEL, for
           mlflow.pyfunc.load_model (uri: MLFLOW_TRACKING_URI, or
           sqlite:///work/mlflow.db)

RUN is the output folder of a finished `hlp run`: what it has learnt is taken
from its folder `work`, and nothing is learnt again.

work=FOLDER looks there instead of in the user's cache, and in ./work of a run.

hlp objects show bracket              what is known of it
hlp objects export bracket learnt/    a folder for another machine
hlp objects register outputs/a lm     what a run has learnt, in MLflow"""
