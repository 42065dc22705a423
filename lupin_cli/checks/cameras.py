"""Cameras held by another process than the one that should have them."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.typed import on_robot
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.units import CAMERAS, UNIT_STATES, VENDOR


def held(evidence: Evidence) -> Iterator[Finding]:
    """Lupin's camera unit takes the cameras over from the vendor's nodes; where it isn't used they are the vendor's."""
    robot = evidence.robot
    devices, units = (robot.get(DEVICES), robot.get(UNIT_STATES)) if robot else (None, None)
    if devices is None or units is None:
        return
    ours, vendor = units.get(CAMERAS), units.get(VENDOR)
    owner = CAMERAS if ours and (ours.running or ours.active == "failed") else VENDOR if vendor and vendor.running else ""
    wrong = [holder for holder in devices.holders_of("/dev/video") if owner and holder.unit != owner]
    if not wrong:
        return
    who = ", ".join(
        sorted({f"{holder.program} ({holder.unit if holder.unit != '-' else 'started by hand'})" for holder in wrong})
    )
    yield Finding(
        id="camera-held",
        severity=Severity.PROBLEM,
        where="robot",
        symptom="black or missing camera pictures; 'Device or resource busy' in the journal",
        cause=f"{who} holds the cameras, which belong to {owner}",
        evidence=(*(holder.line() for holder in wrong), *((ours.line(),) if ours else ())),
        fix=Fix(on_robot(evidence, f"kill {' '.join(sorted({str(h.pid) for h in wrong}))}; sudo systemctl restart {owner}")),
    )


CHECKS = (Check("cameras", held, robot=(DEVICES, UNIT_STATES)),)
