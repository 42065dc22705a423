"""How operations ask and tell a shell: bounded, and an error that says what was wanted and what was said."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from lupin_cli.operations.base import OperationError
from lupin_cli.target.base import ROOT_REFUSED, Output, RootRefused, Script, Target, Unreachable


def quote(word: str) -> str:
    """A word for a shell; a leading `~/` is the home of whoever runs it."""
    return '"$HOME"/' + shlex.quote(word[2:]) if word.startswith("~/") else shlex.quote(word)


def quote_all(words: Sequence[str]) -> str:
    """Words for a shell, one after another."""
    return " ".join(quote(word) for word in words)


def look(target: Target, script: str, *, root: bool = False, bound_s: float = 10.0) -> Output:
    """Ask something, change nothing. The status is the script's; raises OperationError where it didn't end in time."""
    output = target.batch([Script("look", script, bound_s, root)], bound_s + 5.0)["look"]
    if output.status is None:
        if root and output.stderr.startswith(ROOT_REFUSED):
            raise RootRefused(f"{target.name}: {output.stderr.strip()}", "--ask-sudo-password")
        _still_there(target)
        said = output.stderr.strip().splitlines()
        raise OperationError(f"{target.name} did not answer within {bound_s:g} s{': ' + said[-1] if said else ''}")
    return output


def read(target: Target, script: str, what: str, *, root: bool = False, bound_s: float = 10.0) -> str:
    """What a script prints; raises OperationError where it fails, with `what` was to be read."""
    output = look(target, script, root=root, bound_s=bound_s)
    if not output.ok:
        raise OperationError(f"could not read {what} on {target.name}: {_reason(output)}")
    if output.truncated:
        raise OperationError(f"could not read {what} on {target.name}: only {len(output.stdout)} characters of it came")
    return output.stdout


def change(
    target: Target,
    script: str,
    what: str,
    *,
    root: bool = False,
    bound_s: float = 60.0,
    stdin: bytes = b"",
    next_command: str = "",
) -> Output:
    """Change something; raises OperationError with `what` was to be done and what was said."""
    output = target.run(script, root=root, stdin=stdin, bound_s=bound_s)
    if output.status is None:
        _still_there(target)
    if not output.ok:
        raise OperationError(f"could not {what} on {target.name}: {_reason(output)}", next_command)
    return output


def _still_there(target: Target) -> None:
    """Raises Unreachable where a script has no end because its machine is gone: a long script and a cut link look the same."""
    target = getattr(target, "beyond_the_step", target)  # its time may be what ended the script
    alive = target.batch([Script("alive", "true", 3.0)], 5.0)["alive"]
    if not alive.ok:
        raise Unreachable(f"{target.name} no longer answers: {alive.stderr.strip()}", "lost", "lupin doctor")


def _reason(output: Output) -> str:
    lines = [line for line in (output.stderr or output.stdout).strip().splitlines() if line.strip()]
    ended = "it did not end in time" if output.status is None else f"status {output.status}"
    return f"{lines[-1].strip()} ({ended})" if lines else ended
