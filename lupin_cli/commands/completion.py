"""`lupin completion`: print the script by which a shell completes the words of `lupin`."""

from __future__ import annotations

import typer

from lupin_cli.commands.env import SHELLS, complete_shell
from lupin_cli.terminal import echo

# Each asks `lupin` in the way of Typer's completion for bash: the words so far in COMP_WORDS, the index of the word at the
# cursor in COMP_CWORD. It answers with one word a line; if it has none, the shell offers files.
SCRIPTS = {
    "bash": """_lupin_completion() {
    local IFS=$'\\n'
    COMPREPLY=( $(COMP_WORDS="${COMP_WORDS[*]}" COMP_CWORD=$COMP_CWORD _LUPIN_COMPLETE=complete_bash "$1" 2>/dev/null) )
}
complete -o default -F _lupin_completion lupin""",
    "zsh": """#compdef lupin
_lupin_completion() {
    local -a offered
    offered=("${(@f)$(COMP_WORDS="${words[1,$CURRENT]}" COMP_CWORD=$((CURRENT - 1)) \\
        _LUPIN_COMPLETE=complete_bash "${words[1]}" 2>/dev/null)}")
    if [[ -n "${offered[*]}" ]]; then compadd -a offered; else _files; fi
}
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit; }
compdef _lupin_completion lupin""",
    "fish": """function __lupin_completion
    set -l words (commandline -opc)
    set -lx COMP_WORDS (string join ' ' -- $words (commandline -ct))
    set -lx COMP_CWORD (count $words)
    _LUPIN_COMPLETE=complete_bash $words[1] 2>/dev/null
end
complete --arguments '(__lupin_completion)' --command lupin""",
}


def command(
    shell: str = typer.Argument(..., autocompletion=complete_shell, help="bash, zsh or fish."),
) -> None:
    """Print the script for a shell that completes commands, options, robots, runs, playbooks, worlds and processes.

    To have it in every new shell, write the example's line into ~/.bashrc, or with zsh into ~/.zshrc. In fish:
    lupin completion fish | source
    Exit status: 0 printed, 2 usage.

    Example: eval "$(lupin completion bash)"
    """
    if shell not in SHELLS:
        raise typer.BadParameter(f"{shell!r} is none of: {', '.join(SHELLS)}", param_hint="SHELL")
    echo(SCRIPTS[shell], wrap=False)
