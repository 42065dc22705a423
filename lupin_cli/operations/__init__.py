"""Idempotent changes: differs? → change → verify → undo."""

from lupin_cli.operations.base import Difference, Operation, OperationError
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

# Every word that a playbook's step may name.
OPERATIONS: dict[str, type] = {
    operation.name: operation  # type: ignore[attr-defined]
    for operation in (
        ClockOffset,
        ClockStep,
        Command,
        Controllers,
        Directory,
        DiscoveryServer,
        File,
        GroupMembership,
        LaptopDds,
        LineInFile,
        NetworkConnection,
        Probe,
        Process,
        Reboot,
        Release,
        Require,
        Restart,
        Sweep,
        Symlink,
        Unit,
        UnitFile,
        WaitFor,
    )
}

__all__ = ["OPERATIONS", "Difference", "Operation", "OperationError"]
