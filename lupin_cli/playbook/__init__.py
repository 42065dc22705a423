"""Playbooks: lists of operations in YAML, checked before they run; with dry run, journal, resume and undo."""

from lupin_cli.playbook.engine import play
from lupin_cli.playbook.journal import JournalError
from lupin_cli.playbook.model import Playbook
from lupin_cli.playbook.playbook_files import find_playbook, list_shipped, load
from lupin_cli.playbook.results import Event, Result, StepResult
from lupin_cli.playbook.run_record import find_playbook_run, find_run_to_undo, list_runs
from lupin_cli.playbook.yaml_source import PlaybookError

__all__ = [
    "Event",
    "JournalError",
    "Playbook",
    "PlaybookError",
    "Result",
    "StepResult",
    "find_playbook",
    "find_playbook_run",
    "find_run_to_undo",
    "list_runs",
    "list_shipped",
    "load",
    "play",
]
