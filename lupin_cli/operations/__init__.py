"""Idempotent changes: differs? → change → verify → undo."""

from lupin_cli.operations.base import Difference, Operation, OperationError
from lupin_cli.operations.command import Command
from lupin_cli.operations.directory import Directory
from lupin_cli.operations.file import File
from lupin_cli.operations.line_in_file import LineInFile
from lupin_cli.operations.probe import Probe
from lupin_cli.operations.symlink import Symlink

# Every word that a playbook's step may name.
OPERATIONS: dict[str, type] = {
    operation.name: operation  # type: ignore[attr-defined]
    for operation in (Command, Directory, File, LineInFile, Probe, Symlink)
}

__all__ = ["OPERATIONS", "Difference", "Operation", "OperationError"]
