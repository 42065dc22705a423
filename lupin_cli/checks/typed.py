"""Commands that a person types, as findings name them."""

from __future__ import annotations

import shlex

from lupin_cli.checks.base import Evidence


def on_robot(evidence: Evidence, command: str) -> str:
    """The line that runs `command` on the robot from here."""
    address = getattr(evidence.link, "address", "") or getattr(evidence.link, "robot", "") or "ROBOT"
    return f"ssh {address} {shlex.quote(command)}"


def there(evidence: Evidence, machine: str, command: str) -> str:
    """The line that runs `command` on that machine."""
    return on_robot(evidence, command) if machine == "robot" else command
