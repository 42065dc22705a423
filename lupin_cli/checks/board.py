"""The motor board behind telemetrix, and the battery."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.controllers import graphs
from lupin_cli.checks.samples import BOARD, board_silent
from lupin_cli.checks.typed import on_robot
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.journal import JOURNAL
from lupin_cli.facts.units import UNIT_STATES, VENDOR
from lupin_runtime.graph import BATTERY
from lupin_runtime.safety.battery_monitor import LOW_THRESHOLD, normalise

SERIAL_TROUBLE = (
    "usb disconnect",
    "device descriptor read",
    "not accepting address",
    "unable to enumerate",
    "ttyacm",
    "ttyusb",
)
TELEMETRIX_TROUBLE = ("serialexception", "serial", "telemetrix", "timed out")
KEPT = 5


def wedged(evidence: Evidence) -> Iterator[Finding]:
    """telemetrix runs and its board does not speak: commands vanish, wheels spin freely."""
    robot = evidence.robot
    devices = robot.get(DEVICES) if robot else None
    journal = robot.get(JOURNAL) if robot else None
    units = robot.get(UNIT_STATES) if robot else None
    vendor = units.get(VENDOR) if units else None
    mute = [graph for graph in graphs(evidence) if graph.kind == "robot" and board_silent(graph)]
    running = devices.telemetrix if devices else ()
    kernel = (
        [line.raw for line in journal.kernel if any(word in line.text.lower() for word in SERIAL_TROUBLE)] if journal else []
    )
    # Anything that writes to a device is in that state for an instant; only with another sign does it mean something.
    stuck = [process for process in running if process.state == "D" and (mute or kernel)]
    gone = bool(running and devices and not devices.serials and any("disconnect" in line.lower() for line in kernel))
    if not (mute or stuck or gone):
        return
    said = [
        line.raw
        for line in (journal.units if journal else ())
        if "telemetrix" in line.raw.lower() and any(word in line.text.lower() for word in TELEMETRIX_TROUBLE)
    ]
    if gone:
        cause = "the board left the USB bus and telemetrix goes on without it"
    elif stuck:
        cause = "telemetrix hangs in the kernel, waiting for the board's serial port"
    else:
        cause = "telemetrix runs and the board behind it is silent"
    yield Finding(
        id="board-wedged",
        severity=Severity.PROBLEM,
        where="robot",
        symptom="wheels spin freely and ignore commands; battery, IMU and red button say nothing",
        cause=cause,
        evidence=(
            *(f"{name}: {graph.heard(name)} samples" for graph in mute for name in BOARD if graph.heard(name) is not None),
            *(f"telemetrix: pid {process.pid} state {process.state}: {process.command}" for process in running),
            *(devices.serials if devices and devices.serials else ("no /dev/ttyACM* and no /dev/ttyUSB*",) if devices else ()),
            *kernel[-KEPT:],
            *said[-KEPT:],
            *((vendor.line(),) if vendor else ()),
        ),
        fix=Fix(
            f"unplug the board's USB cable and plug it in again, then: {on_robot(evidence, f'sudo systemctl restart {VENDOR}')}"
        ),
        explains=frozenset({"battery-unreadable", *(f"topic-silent:{name}" for name in BOARD)}),
    )


def battery(evidence: Evidence) -> Iterator[Finding]:
    """A battery that is low, or that nobody can read: the net under a mission is gone then."""
    for graph in graphs(evidence):
        if graph.battery is None:
            continue
        percentage, voltage = graph.battery
        charge = normalise(percentage)
        told = "NaN" if percentage is None else f"{percentage:.3f}"
        line = f"{BATTERY.name} on {graph.name}: percentage {told}, voltage {'NaN' if voltage is None else f'{voltage:.2f} V'}"
        if charge is None:
            yield Finding(
                id="battery-unreadable",
                severity=Severity.WARNING,
                where=graph.where,
                symptom="a mission is not ended when the battery runs low",
                cause="the power watcher's percentage is no number between 0 and 1 (or 0 and 100)",
                evidence=(line,),
                fix=Fix(on_robot(evidence, f"sudo systemctl restart {VENDOR}")),
            )
        elif charge < LOW_THRESHOLD:
            yield Finding(
                id="battery-low",
                severity=Severity.PROBLEM,
                where=graph.where,
                symptom="missions turn back to the dock; servos and single-board computer brown out",
                cause=f"the battery is at {charge:.0%}, below {LOW_THRESHOLD:.0%}",
                evidence=(line,),
                fix=Fix("charge the battery" if graph.kind == "robot" else "lupin sim --help"),
            )


CHECKS = (
    Check("board.motor", wedged, (GRAPH,), (DEVICES, JOURNAL, UNIT_STATES), closer_laptop=(GRAPH,)),
    Check("board.battery", battery, laptop=(GRAPH,)),
)
