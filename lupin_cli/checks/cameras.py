"""Cameras held by another process than their owner."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.units import CAMERAS, UNIT_STATES, VENDOR


def find_held_cameras(snapshot: Snapshot) -> Iterator[Finding]:
    """A camera is open in a process of another unit than Lupin's camera unit or, without that, the vendor's."""
    devices, units = snapshot.robot_fact(DEVICES), snapshot.robot_fact(UNIT_STATES)
    if devices is None or units is None:
        return
    lupin, vendor = units.get(CAMERAS), units.get(VENDOR)
    owner = CAMERAS if lupin and (lupin.running or lupin.active == "failed") else VENDOR if vendor and vendor.running else ""
    wrong = [holder for holder in devices.holders_of("/dev/video") if owner and holder.unit != owner]
    if not wrong:
        return
    programs = sorted({f"{holder.program} ({holder.unit if holder.unit != '-' else 'started by hand'})" for holder in wrong})
    pids = " ".join(sorted({str(holder.pid) for holder in wrong}))
    yield make_finding(
        "camera-held",
        where="robot",
        cause=f"{', '.join(programs)} holds the cameras, which belong to {owner}",
        evidence=(*(holder.line() for holder in wrong), *((lupin.line(),) if lupin else ())),
        command=command_on_robot(snapshot, f"kill {pids}; sudo systemctl restart {owner}"),
    )


CHECKS = (Check("cameras", find_held_cameras, robot=(DEVICES, UNIT_STATES)),)
