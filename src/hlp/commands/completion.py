"""`hlp -sc install=bash`: completion of commands, groups, alternatives and keys in the shell.

Hydra's own scripts ask `hlp -sc query=SHELL` with what was typed so far in `COMP_LINE`. Hydra
knows groups and keys; commands, and the keys of the commands without a configuration, are ours.
"""

import os
import re
from collections.abc import Sequence

from hlp.commands import composing

OPTIONS = ("-sc", "--shell-completion")
_CONFIGURED = ("run", "bench", "search")


def command(arguments: Sequence[str], commands: Sequence[str]) -> None:
    """Print the script (`install=SHELL`, `uninstall=SHELL`), or the words that fit (`query`)."""
    if not arguments[1:] or not arguments[1].startswith("query="):
        _ask_hydra(arguments)
        return
    program, *words = os.environ.get("COMP_LINE", "hlp ").split(" ")
    if len(words) < 2:
        begun = words[0] if words else ""
        print(" ".join(each for each in (*commands, "-m") if each.startswith(begun)))
    elif words[0] in (*_CONFIGURED, *composing.MULTIRUN):
        rest = words if words[0] in composing.MULTIRUN else words[1:]
        os.environ["COMP_LINE"] = " ".join([program, *rest])
        _ask_hydra(arguments)
    elif words[0] in commands:
        print(" ".join(each for each in _own_keys(words[0]) if each.startswith(words[-1])))


def _ask_hydra(arguments: Sequence[str]) -> None:
    composing.compose_and_call("", arguments, lambda config: None, composing.config_folder())


def _own_keys(name: str) -> list[str]:
    """The keys that the help of a command names."""
    from importlib import import_module

    module = import_module(f"hlp.commands.{name}")
    help_text = str(getattr(module, f"{name.upper()}_HELP", ""))
    found = re.findall(r"\b([a-z][a-z_]*)=", help_text)
    return [f"{key}=" for key in dict.fromkeys(found)]
