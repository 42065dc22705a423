"""Commands that a person types, as findings show them."""

from __future__ import annotations

import shlex

from lupin_cli.checks.base import Snapshot


def command_on_robot(snapshot: Snapshot, command: str) -> str:
    """Return the `ssh` line that runs `command` on the robot."""
    address = (snapshot.link.address or snapshot.link.robot) if snapshot.link else ""
    return f"ssh {address or 'ROBOT'} {shlex.quote(command)}"


def command_on(snapshot: Snapshot, machine: str, command: str) -> str:
    """Return the line that runs `command` on `machine` ("laptop" or "robot"), typed on the laptop."""
    return command_on_robot(snapshot, command) if machine == "robot" else command


def robot_option(snapshot: Snapshot) -> str:
    """Return ` --robot NAME` for a `lupin` command that acts on the robot of the snapshot; empty if none was selected."""
    return f" --robot {snapshot.link.robot}" if snapshot.link else ""
