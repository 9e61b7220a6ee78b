"""`hlp -sc install=bash`: completion of commands, groups, alternatives and keys in the shell.

A script in the shell asks `hlp -sc query=SHELL` with what was typed so far in `COMP_LINE`; those
for bash and fish are Hydra's. The words are ours: commands, their keys, groups and keys of the
configuration. Hydra is asked, which takes a second, for its own settings and where a folder of
one's own configuration is named.
"""

import hashlib
import os
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import hlp
from hlp.commands import composing
from hlp.user_cache import KeptValues, writable_folder

OPTIONS = ("-sc", "--shell-completion")
_CONFIGURED = ("run", "bench", "search")
_OWN_CONFIGURATION = ("--config", "-cd", "-cn", "-cp")
_OF_HYDRA = ("hydra", "-", "+", "~")
# Hydra's script for zsh is that for bash, which zsh runs only after `bashcompinit`.
_ZSH = {
    "install=zsh": """\
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }
_hlp() {
    local -a found
    found=(${(f)"$(COMP_LINE="${(j: :)words[1,CURRENT]}" $words[1] -sc query=zsh)"})
    if (( $#found )); then
        compadd -Q -S '' -- $found
    else
        compset -P '*='
        _files
    fi
}
compdef _hlp hlp""",
    "uninstall=zsh": "compdef -d hlp; unfunction _hlp",
}
_BY_LINE = "query=fish"  # Hydra's words one below the other, as zsh wants them too


def command(arguments: Sequence[str], commands: Sequence[str]) -> None:
    """Print the script (`install=SHELL`, `uninstall=SHELL`), or the words that fit (`query`)."""
    wanted = arguments[1] if arguments[1:] else ""
    if wanted in _ZSH:
        print(_ZSH[wanted])
    elif not wanted.startswith("query="):
        _ask_hydra(arguments)
    elif wanted == "query=bash":
        _answer(arguments, commands, " ")
    else:
        _answer([arguments[0], _BY_LINE], commands, "\n")


def _answer(arguments: Sequence[str], commands: Sequence[str], separator: str) -> None:
    """Print the words that may stand for the last one of `COMP_LINE`."""
    program, *words = os.environ.get("COMP_LINE", "hlp ").split(" ")
    if len(words) < 2:
        begun = words[0] if words else ""
        print(separator.join(each for each in (*commands, "-m") if each.startswith(begun)))
    elif words[0] in (*_CONFIGURED, *composing.MULTIRUN):
        rest = words if words[0] in composing.MULTIRUN else words[1:]
        own = any(each.startswith(_OWN_CONFIGURATION) for each in words)
        if own or words[-1].startswith(_OF_HYDRA):
            os.environ["COMP_LINE"] = " ".join([program, *rest])
            _ask_hydra(arguments)
        else:
            found = configuration_words(rest, composing.config_folder(), _keys)
            print(separator.join(found))
    elif words[0] in commands:
        print(separator.join(each for each in _own_keys(words[0]) if each.startswith(words[-1])))


def _ask_hydra(arguments: Sequence[str]) -> None:
    composing.compose_and_call("", arguments, lambda config: None, composing.config_folder())


def _keys(choices: Sequence[str]) -> list[str]:
    """The keys of the values of the configuration with these choices; none if one is wrong."""
    from hydra.errors import HydraException

    from hlp.commands.hydra_errors import all_keys

    try:
        keys = all_keys(*choices)
    except HydraException:
        return []
    nodes = {key.rpartition(".")[0] for key in keys}
    return [key for key in keys if key not in nodes]


def _own_keys(name: str) -> list[str]:
    """The keys that the help of a command names."""
    from importlib import import_module

    module = import_module(f"hlp.commands.{name}")
    help_text = str(getattr(module, f"{name.upper()}_HELP", ""))
    found = re.findall(r"\b([a-z][a-z_]*)=", help_text)
    return [f"{key}=" for key in dict.fromkeys(found)]


_KEPT = 50  # choices of alternatives


def configuration_words(
    words: Sequence[str], folder: Path, compose: Callable[[Sequence[str]], Sequence[str]]
) -> list[str]:
    """The words that may stand for the last of `words`, all after it begins as they do.

    `folder` is that of the configuration; `compose` gives all keys for some choices of
    alternatives, e.g. `task=search`. Dots and `=` are kept at the end of what goes on.
    """
    typed, groups = words[-1], _groups(folder)
    name, sign, _ = typed.partition("=")
    if sign:
        return _fitting((f"{name}={each}" for each in _alternatives(folder, name)), typed)
    chosen = [each for each in words[:-1] if each.partition("=")[0] in groups and "," not in each]
    keys = _kept(chosen, folder, compose)
    depth = typed.count(".") + 1
    parts = (key.split(".") for key in keys)
    nodes = {
        ".".join(each[:depth]) + ("." if len(each) > depth else "=")
        for each in parts
        if len(each) >= depth
    }
    nodes |= {f"{group}=" for group in groups if _alternatives(folder, group)}
    return _fitting(nodes, typed)


def _fitting(candidates: Iterable[str], typed: str) -> list[str]:
    return sorted(each for each in candidates if each.startswith(typed))


def _groups(folder: Path) -> set[str]:
    """The groups of the configuration, those within others too: `refinement/cost`."""
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_dir() and not path.name.startswith(("_", "."))
    }


def _alternatives(folder: Path, group: str) -> list[str]:
    return [path.stem for path in (folder / group).glob("*.yaml")]


def _kept(
    chosen: Sequence[str], folder: Path, compose: Callable[[Sequence[str]], Sequence[str]]
) -> list[str]:
    """The keys for these choices, from the cache if they are in it."""
    kept = KeptValues(writable_folder("completion"), "keys.json", _state(folder))
    known, choice = kept.read(), " ".join(chosen)
    if choice in known:
        return list(known[choice])
    keys = list(compose(chosen))
    kept.write(dict(list(known.items())[-_KEPT + 1 :]) | {choice: keys})
    return keys


def _state(folder: Path) -> str:
    """A digest of what the keys are made from: files of the configuration, and the code."""
    package = Path(hlp.__file__).parent
    digest = hashlib.blake2b(hlp.__version__.encode(), digest_size=16)
    for path in sorted([*folder.rglob("*.yaml"), *package.rglob("*.py")]):
        about = path.stat()
        digest.update(f"{path} {about.st_size} {about.st_mtime_ns}\n".encode())
    return digest.hexdigest()
