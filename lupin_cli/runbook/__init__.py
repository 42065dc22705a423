"""Playbooks: validated YAML over operations, with dry run, journal, resume and rollback."""

from lupin_cli.runbook.engine import play
from lupin_cli.runbook.journal import JournalError, find_run, list_runs
from lupin_cli.runbook.language import Playbook
from lupin_cli.runbook.library import find_playbook, load, shipped
from lupin_cli.runbook.outcome import Event, Result, StepResult
from lupin_cli.runbook.source import PlaybookError

__all__ = [
    "Event",
    "JournalError",
    "Playbook",
    "PlaybookError",
    "Result",
    "StepResult",
    "find_playbook",
    "find_run",
    "list_runs",
    "load",
    "play",
    "shipped",
]
