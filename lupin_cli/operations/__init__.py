"""Idempotent changes as data: a probe, a pure judgement of its output, a change and its undo. The table is in `table.py`."""

from lupin_cli.operations.base import Difference, Operation, OperationError

__all__ = ["Difference", "Operation", "OperationError"]
