"""What every operation promises, tried on a real machine."""

from __future__ import annotations

import json
import time
from typing import Any

from lupin_cli.operations import Difference
from lupin_cli.target.base import Target


def settled(operation: Any, target: Target, before: dict[str, Any], limit_s: float = 20.0) -> None:
    """Wait until nothing differs any more, as the runner does."""
    if hasattr(operation, "begun"):
        operation = operation.begun(before)
    deadline = time.monotonic() + limit_s
    while (left := operation.differs(target)) is not None:
        assert time.monotonic() < deadline, left
        time.sleep(0.1)


def there_and_back(operation: Any, target: Target) -> Difference:
    """differs → change → settled → a second change would do nothing → undo, twice → it differs as before. Returns how."""
    difference = operation.differs(target)
    assert difference is not None and difference.summary and "\n" not in difference.summary
    before = json.loads(json.dumps(difference.before))
    operation.change(target, difference)
    settled(operation, target, before)
    operation.undo(target, before)
    operation.undo(target, before)
    again = operation.differs(target)
    assert again is not None and again.before == before, again
    return difference
