"""Idempotent changes: differs? → change → verify → undo."""

from lupin_cli.operations.base import Difference, Operation, OperationError

__all__ = ["Difference", "Operation", "OperationError"]
