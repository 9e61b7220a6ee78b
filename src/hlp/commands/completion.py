"""`hlp -sc install=bash`: completion of commands, groups, alternatives and keys in the shell.

A script in the shell asks `hlp -sc query=SHELL` with what was typed so far in `COMP_LINE`; those
for bash and fish are Hydra's. Commands and their keys are completed here, groups and keys of the
configuration by Hydra, which takes a second.
"""

import os
import re
from collections.abc import Sequence

from hlp.commands import MULTIRUN, help_text

OPTIONS = ("-sc", "--shell-completion")
_CONFIGURED = ("run", "bench", "search")
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


def complete(arguments: Sequence[str], commands: Sequence[str]) -> None:
    """Print the script (`install=SHELL`, `uninstall=SHELL`), or the words that fit (`query`)."""
    option, action = [*arguments, ""][:2]
    program, *words = os.environ.get("COMP_LINE", "hlp ").split(" ")
    if action in _ZSH:
        print(_ZSH[action])
    elif not action.startswith("query="):
        _ask_hydra(arguments)
    elif words and words[:-1] and words[0] in {*_CONFIGURED, *MULTIRUN}:
        overrides = words[1:] if words[0] in _CONFIGURED else words
        os.environ["COMP_LINE"] = " ".join([program, *overrides])
        # In the form for fish, Hydra's words stand one below the other, as zsh wants them too.
        _ask_hydra([option, action.replace("zsh", "fish")])
    else:
        known = [*commands, "-m"] if len(words) < 2 else _own_words(words[0], commands)
        fitting = [word for word in known if word.startswith(words[-1] if words else "")]
        print((" " if action == "query=bash" else "\n").join(fitting))


def _ask_hydra(arguments: Sequence[str]) -> None:
    from hlp.commands import composing

    composing.compose_and_call("", arguments, lambda config: None)


def _own_words(name: str, commands: Sequence[str]) -> list[str]:
    """The words that the help of a command says it takes, then the keys that it names."""
    text = help_text(name) if name in commands else ""
    words = re.findall(rf"^(?:usage:)? +hlp {name} ([a-z]+)\b(?!=)", text, re.MULTILINE)
    if name == "download":
        words = re.findall(r"^  ([a-z]\w*) +\S+: ", text, re.MULTILINE)
    found = re.findall(r"\b([a-z][a-z_]*)=", text)
    return [*dict.fromkeys(words), *(f"{key}=" for key in dict.fromkeys(found))]
