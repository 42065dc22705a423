"""Where a run begins: the unfinished run that it resumes, with its variables, or the step that the operator names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lupin_cli.playbook.journal import JournalError
from lupin_cli.playbook.model import Playbook
from lupin_cli.playbook.run_record import RunRecord, list_runs
from lupin_cli.playbook.yaml_source import PlaybookError, suggest


def play_command(playbook: str, robot: str) -> str:
    """Return the command that plays a playbook on a robot; `robot` is empty for the laptop."""
    return f"lupin play {playbook}" + (f" --robot {robot}" if robot else "")


def find_unfinished(playbook: Playbook, robot: str, folder: Path | None) -> RunRecord | None:
    """Return the newest run of this playbook on this robot if it can be resumed; None if it is done or there is no run.

    Raises JournalError if it is still running or has run its `always` steps; PlaybookError if the playbook's text has changed.
    """
    for run in list_runs(folder):
        if (run.playbook, run.robot) != (playbook.name, robot) or run.undo_of:
            continue
        if run.state == "running":
            raise JournalError(f"the run {run.run} is still going on", f"lupin journal show {run.run}")
        if run.finished:
            return None
        if run.closed:
            message = f"{run.run} failed and then ran its 'always' steps, so there is nothing to resume; play it again"
            raise JournalError(message, play_command(playbook.name, robot))
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
        options = " ".join(f"-v {name}=..." for name in missing)
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
