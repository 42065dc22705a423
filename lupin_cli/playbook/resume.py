"""Where a run begins: the unfinished run that it resumes, with its variables, or the step that the operator names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from lupin_cli.playbook.argument_types import to_command_line
from lupin_cli.playbook.journal import JournalError
from lupin_cli.playbook.model import Playbook
from lupin_cli.playbook.run_record import RunRecord, list_runs, undone_runs
from lupin_cli.playbook.yaml_source import PlaybookError, suggest
from lupin_cli.printed_commands import lupin


def play_command(
    playbook: Playbook, robot: str, variables: Mapping[str, Any], from_step: str = "", tags: Iterable[str] = ()
) -> str:
    """Return the command that plays a playbook on a robot, with the variables that were given; it asks for the secrets.

    `robot` is empty for the laptop.
    """
    types = {variable.name: variable.type for variable in playbook.variables}
    options = ["--from", from_step] if from_step else []
    for tag in tags:
        options += ["--tag", tag]
    for name, value in variables.items():
        options += ["--hidden", name] if types.get(name) == "secret" else ["-v", f"{name}={to_command_line(value)}"]
    return lupin("play", playbook.typed_name, *options, robot=robot)


def resume_command(playbook: Playbook, robot: str) -> str:
    """Return the command that continues a run, with the variables that its journal has."""
    return lupin("play", playbook.typed_name, "--resume", robot=robot)


def find_unfinished(playbook: Playbook, robot: str, folder: Path | None) -> RunRecord | None:
    """Return the newest run of this playbook on this robot if it can be resumed; None if it is done or there is no run.

    Raises JournalError if it is still running, has run its `always` steps, or its undo has begun; PlaybookError if the
    playbook's text has changed.
    """
    runs = list_runs(folder)
    for run in runs:
        if (run.playbook, run.robot) != (playbook.name, robot) or run.undo_of:
            continue
        if run.state == "running":
            raise JournalError(f"the run {run.run} is still going on", f"lupin journal show {run.run}")
        if run.finished:
            return None
        if run.closed or run.run in undone_runs(runs):
            why = f"{run.run} failed and then ran its 'always' steps" if run.closed else f"an undo of {run.run} has begun"
            message = f"{why}, so there is nothing to resume; play it again"
            raise JournalError(message, run.command or play_command(playbook, robot, run.variables))
        if run.digest != playbook.digest:
            raise PlaybookError(
                f"has changed since the run {run.run}: undo that run, or play the playbook again", playbook.file
            )
        return run
    return None


def merge_variables(playbook: Playbook, prior: RunRecord, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a resumed run's variables. Raises PlaybookError for another value, or for a secret that is not given again."""
    for name, value in given.items():
        if name in prior.variables and prior.variables[name] != value:
            raise PlaybookError(f"{prior.run} was started with {name}={prior.variables[name]}, not {value}", f"-v {name}")
    missing = [name for name in prior.secrets if name not in given]
    if missing:
        options = " ".join(f"--hidden {name}" for name in missing)
        raise PlaybookError(f"the journal has no secrets; give them again: {options}", playbook.file)
    return {**prior.variables, **given}


def index_of_step(playbook: Playbook, word: str) -> int:
    """Return the index of the step with this name or number (from 1). Raises PlaybookError."""
    names = [step.name for step in playbook.steps]
    if word.isdecimal() and 1 <= int(word) <= len(names):
        return int(word) - 1
    if word in names:
        return names.index(word)
    message = f"there is no step {word!r}, by name or by number from 1 to {len(names)}{suggest(word, names)}"
    raise PlaybookError(message, playbook.file)


def select_steps(playbook: Playbook, first: int, tags: Iterable[str]) -> frozenset[int]:
    """Return the indices of the steps from `first` on that have one of the tags, or of all if no tags are given.

    Raises PlaybookError for a tag that no step has.
    """
    wanted = frozenset(tags)
    for tag in sorted(wanted - playbook.tags):
        known = f"; its tags are {', '.join(sorted(playbook.tags))}" if playbook.tags else ""
        raise PlaybookError(f"no step has the tag {tag!r}{suggest(tag, playbook.tags) or known}", playbook.file)
    return frozenset(i for i, step in enumerate(playbook.steps) if i >= first and (not wanted or wanted & step.tags))
