"""`hlp objects`: what is learnt and kept in the user's cache."""

import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from hlp.commands import help_text
from hlp.commands.arguments import nearest, tracking_uri
from hlp.errors import InputError
from hlp.files import MANIFEST, expanded
from hlp.method.learn.learnt_folder import LearntFolder, check_files, read_record
from hlp.runs import learnt_cache
from hlp.runs.learnt_cache import find_learnt

_WORDS = ("list", "show", "remove", "export", "register")


def objects(arguments: Sequence[str]) -> None:
    """List, show, remove or export entries of the cache."""
    words = [word for word in arguments if not word.startswith(("work=", "uri="))]
    uri = next((word[4:] for word in arguments if word.startswith("uri=")), tracking_uri())
    work = next((word[5:] for word in arguments if word.startswith("work=")), None)
    cache = learnt_cache.cache_folder(work)
    match words:
        case ["list"]:
            print(_listed(cache))
        case ["show", name]:
            print(_shown(find_learnt(name, cache)))
        case ["remove", name]:
            print(f"removed {learnt_cache.remove_learnt(name, cache)}")
        case ["export", name, target]:
            with _whole(name, cache, work) as folder:
                learnt_cache.export_learnt(folder, expanded(target))
            print(f"copied to {expanded(target)}")
        case ["register", name, model]:
            from hlp.runs.mlflow_log import register_learnt

            with _whole(name, cache, work) as folder:
                address = register_learnt(folder, model, uri)
            print(f"registered {address}; in Python: mlflow.pyfunc.load_model('{address}')")
        case _:
            word = words[0] if words else ""
            form = re.search(rf"hlp objects {re.escape(word)} .*", help_text("objects"))
            hint = f": it must be {form[0]}," if form else nearest(word, _WORDS) or ":"
            raise InputError(f"cannot use '{' '.join(words)}'{hint} see `hlp objects --help`")


@contextmanager
def _whole(given: str, cache: Path, work: str | None) -> Iterator[Path]:
    """An undamaged folder of learnt objects: one by path or name, or of what a run has learnt."""
    manifest = expanded(given) / MANIFEST
    if not manifest.is_file():
        whole = find_learnt(given, cache)
        check_files(whole, read_record(whole))
        yield whole
        return
    from hlp.commands.composing import compose_config  # Hydra: a second, for a run alone
    from hlp.commands.learn import learnt_of_run
    from hlp.config.build import build_run
    from hlp.runs.manifest import check_manifest, config_of

    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "config.yaml").write_text(config_of(manifest, ()))
        places = (f"work='{work or 'work'}'", "output=none")
        run = build_run(compose_config(*places, folder=Path(folder)))
        check_manifest(run, manifest)
        learnt = Path(folder, "learnt")
        learnt_of_run(run, manifest, learnt)
        yield learnt


def _listed(cache: Path) -> str:
    entries = learnt_cache.list_learnt(cache)
    if not entries:
        return f"nothing is learnt yet in {cache}: hlp learn mesh=FILE"
    lines = [
        f"{entry.name:<28} {entry.size / 1e6:6.0f} MB  {entry.problem or ', '.join(entry.objects)}"
        for entry in entries
    ]
    return "\n".join([*lines, f"in {cache}"])


def _shown(folder: Path) -> str:
    lines = [f"{folder}: {learnt_cache.describe_learnt(folder).size / 1e6:.0f} MB"]
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
            f"  symmetries  {len(model.symmetries) - 1}; "
            f"{len(model.near_symmetries)} more that only colours tell apart",
            f"  patches     windows {model.holistic_size * 1000:.0f} mm, "
            f"local {local.side_of(model.local_size) * 1000:.0f} mm",
        ]
    return "\n".join(lines)
