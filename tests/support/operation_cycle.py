"""Tests on a real machine what every operation guarantees: it changes once, verifies, and can be undone repeatedly."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from lupin_cli.connection.base import Target
from lupin_cli.operations import Difference, Operation
from lupin_cli.operations.restored_state import read_digests
from lupin_cli.operations.shell import observe
from tests.support.waiting import wait_until


def examine(operation: Operation, target: Target) -> Difference | None:
    """Return what the operation would change on the target."""
    return operation.judge(observe(operation, target))


def report(operation: Operation, target: Target) -> dict[str, Any]:
    """Return what the operation reports for later steps."""
    return operation.report(observe(operation, target))


def require_difference(operation: Operation, target: Target) -> Difference:
    """Return what the operation would change; fails if nothing differs."""
    difference = examine(operation, target)
    assert difference is not None
    return difference


def apply(operation: Operation, target: Target) -> Difference:
    """Make the change once, without verification; fails if nothing differs."""
    difference = require_difference(operation, target)
    operation.change(target, difference)
    return difference


def wait_until_settled(operation: Operation, target: Target, before: Mapping[str, Any] | None = None) -> None:
    """Wait until the operation would change nothing, like the engine; `before` is the state before the step."""
    if before is not None:
        operation = operation.with_baseline(before)
    wait_until(lambda: examine(operation, target) is None, lambda: f"no difference: {examine(operation, target)}")


def apply_and_undo(operation: Operation, target: Target) -> Difference:
    """Apply, verify that it would change nothing more, undo twice, verify the same difference; return the difference."""
    difference = require_difference(operation, target)
    assert difference.summary and "\n" not in difference.summary
    before = json.loads(json.dumps(difference.before))
    found = read_digests(operation, target)
    operation.change(target, difference)
    wait_until_settled(operation, target, before)
    operation.undo(target, before)
    operation.undo(target, before)
    again = examine(operation, target)
    assert again is not None and again.before == before, again
    assert read_digests(operation, target) == found, "an undone step does not count as changed by somebody else"
    return difference
