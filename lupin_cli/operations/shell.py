"""Run an operation's scripts on a target, with timeouts, and errors that say what was attempted and what the script printed."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from lupin_cli.connection.base import ROOT_REFUSED, Output, RootRefused, Script, Target, Unreachable
from lupin_cli.operations.base import PROBE_TIMEOUT_S, Operation, OperationError, probe_script
from lupin_cli.operations.step_target import StepTarget
from lupin_cli.printed_commands import lupin

_NO_OUTPUT = Output(0, "")
_BATCH_SLACK_S = 5.0


def quote(word: str) -> str:
    """Quote a word for a shell. A leading `~/` stays the home of the user who runs the script."""
    return '"$HOME"/' + shlex.quote(word[2:]) if word.startswith("~/") else shlex.quote(word)


def quote_all(words: Sequence[str]) -> str:
    """Quote several words for a shell."""
    return " ".join(quote(word) for word in words)


def observe(operation: Operation, target: Target, prefetched: Output | None = None) -> Output:
    """Return what the operation judges: its probe's output, completed.

    `prefetched` is the probe's output if it has already run. Raises OperationError, or TargetError from the target.
    """
    script = operation.probe()
    output = prefetched or (_NO_OUTPUT if script is None else run_probe(target, script))
    return operation.complete(target, output)


def query(target: Target, script: str, *, root: bool = False, timeout_s: float = PROBE_TIMEOUT_S) -> Output:
    """Run a read-only script. Any exit status is fine; raises OperationError if the script did not finish in time."""
    return run_probe(target, probe_script(script, root=root, timeout_s=timeout_s))


def run_probe(target: Target, script: Script) -> Output:
    """Run one probe; see `query`."""
    output = target.batch([script], script.timeout_s + _BATCH_SLACK_S)[script.name]
    if output.status is None:
        if script.root and output.stderr.startswith(ROOT_REFUSED):
            is_robot = bool(target.login_command)
            ask = lupin("robots", "check", target.name, "--ask-sudo-password") if is_robot else "sudo -v"
            raise RootRefused(f"{target.name}: {output.stderr.strip()}", ask)
        _require_reachable(target)
        lines = output.stderr.strip().splitlines()
        raise OperationError(f"{target.name} did not answer within {script.timeout_s:g} s{': ' + lines[-1] if lines else ''}")
    return output


def text_of(output: Output, what: str) -> str:
    """Return what a probe printed; raises OperationError, naming `what` was to be read, if it failed or was cut off."""
    if not output.ok:
        raise OperationError(f"could not read {what}: {_reason(output)}")
    if output.truncated:
        raise OperationError(f"could not read {what}: the output was cut off after {len(output.stdout)} characters")
    return output.stdout


def key_values(output: Output, what: str) -> dict[str, str]:
    """Return the `KEY=VALUE` lines that a probe printed; raises OperationError as `text_of` does."""
    return dict(line.split("=", 1) for line in text_of(output, what).splitlines() if "=" in line)


def change(
    target: Target,
    script: str,
    what: str,
    *,
    root: bool = False,
    timeout_s: float = 60.0,
    stdin: bytes = b"",
    next_command: str = "",
) -> Output:
    """Run a script that changes something; raises OperationError with `what` it was to do and what it printed."""
    output = target.run(script, root=root, stdin=stdin, timeout_s=timeout_s)
    if output.status is None:
        _require_reachable(target)
    if not output.ok:
        raise OperationError(f"could not {what} on {target.name}: {_reason(output)}", next_command)
    return output


def _require_reachable(target: Target) -> None:
    """Raise Unreachable if the machine no longer answers: a script that times out and a cut link look the same."""
    if isinstance(target, StepTarget):
        target = target.unlimited  # the step's timeout may be what stopped the script
    alive = target.batch([Script("alive", "true", 3.0)], 5.0)["alive"]
    if not alive.ok:
        raise Unreachable(f"{target.name} no longer answers: {alive.stderr.strip()}", "lost", "lupin doctor")


def _reason(output: Output) -> str:
    lines = [line for line in (output.stderr or output.stdout).strip().splitlines() if line.strip()]
    ending = "it did not end in time" if output.status is None else f"status {output.status}"
    return f"{lines[-1].strip()} ({ending})" if lines else ending
