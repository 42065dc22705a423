"""Every operation that a step of a playbook may name, in the order of docs/playbooks.md."""

from __future__ import annotations

from lupin_cli.operations.base import Operation
from lupin_cli.operations.clock_offset import ClockOffset
from lupin_cli.operations.clock_step import ClockStep
from lupin_cli.operations.command import Command
from lupin_cli.operations.controllers import Controllers
from lupin_cli.operations.directory import Directory
from lupin_cli.operations.discovery_server import DiscoveryServer
from lupin_cli.operations.file import File
from lupin_cli.operations.group_membership import GroupMembership
from lupin_cli.operations.laptop_dds import LaptopDds
from lupin_cli.operations.line_in_file import LineInFile
from lupin_cli.operations.network_connection import NetworkConnection
from lupin_cli.operations.probe import Probe
from lupin_cli.operations.process import Process
from lupin_cli.operations.reboot import Reboot
from lupin_cli.operations.release import Release
from lupin_cli.operations.require import Require
from lupin_cli.operations.restart import Restart
from lupin_cli.operations.sweep import Sweep
from lupin_cli.operations.symlink import Symlink
from lupin_cli.operations.unit import Unit
from lupin_cli.operations.unit_file import UnitFile
from lupin_cli.operations.wait_for import WaitFor

_TABLE: tuple[type[Operation], ...] = (
    File,
    LineInFile,
    Directory,
    Symlink,
    Unit,
    UnitFile,
    Restart,
    GroupMembership,
    NetworkConnection,
    LaptopDds,
    DiscoveryServer,
    Release,
    Controllers,
    Sweep,
    Process,
    ClockStep,
    Reboot,
    Command,
    WaitFor,
    Require,
    Probe,
    ClockOffset,
)

OPERATIONS: dict[str, type[Operation]] = {operation.name: operation for operation in _TABLE}


def as_markdown() -> str:
    """Return the table of docs/playbooks.md."""
    rows = [f"| `{each.name}` | {each.effect} | {each.undo_effect} |" for each in _TABLE]
    return "\n".join(["| Operation | What it ensures | Undo |", "|---|---|---|", *rows]) + "\n"
