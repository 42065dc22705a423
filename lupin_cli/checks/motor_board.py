"""The motor board behind telemetrix, and the battery."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.controllers import visited_graphs
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.checks.topic_delivery import BOARD_TOPICS, is_board_silent
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.units import UNIT_STATES, VENDOR
from lupin_runtime.graph import BATTERY
from lupin_runtime.safety.battery_monitor import LOW_THRESHOLD, normalize

# Words of kernel messages about a lost serial device.
SERIAL_TROUBLE = (
    "usb disconnect",
    "device descriptor read",
    "not accepting address",
    "unable to enumerate",
    "ttyacm",
    "ttyusb",
)
TELEMETRIX_TROUBLE = ("serialexception", "serial", "telemetrix", "timed out")
JOURNAL_LINES = 5


def find_wedged_board(snapshot: Snapshot) -> Iterator[Finding]:
    """telemetrix runs, but its board does not answer: commands have no effect, wheels spin freely."""
    devices = snapshot.robot_fact(DEVICES)
    journal = snapshot.robot_fact(SYSTEM_JOURNAL)
    units = snapshot.robot_fact(UNIT_STATES)
    vendor = units.get(VENDOR) if units else None
    silent_graphs = [graph for graph in visited_graphs(snapshot) if graph.kind == "robot" and is_board_silent(graph)]
    processes = devices.telemetrix if devices else ()
    kernel = (
        [line.raw for line in journal.kernel if any(word in line.text.lower() for word in SERIAL_TROUBLE)] if journal else []
    )
    # Every process that writes to a device is in state D for an instant; it counts only with a second sign.
    blocked_processes = [process for process in processes if process.state == "D" and (silent_graphs or kernel)]
    left_bus = bool(processes and devices and not devices.serials and any("disconnect" in line.lower() for line in kernel))
    if not (silent_graphs or blocked_processes or left_bus):
        return
    errors = [
        line.raw
        for line in (journal.units if journal else ())
        if "telemetrix" in line.raw.lower() and any(word in line.text.lower() for word in TELEMETRIX_TROUBLE)
    ]
    if left_bus:
        cause = "the board left the USB bus, and telemetrix continues without it"
    elif blocked_processes:
        cause = "telemetrix hangs in the kernel, waiting for the board's serial port"
    else:
        cause = "telemetrix runs, but its board sends nothing"
    restart = command_on_robot(snapshot, f"sudo systemctl restart {VENDOR}")
    yield make_finding(
        "board-wedged",
        where="robot",
        cause=cause,
        evidence=(
            *(
                f"{name}: {graph.sample_count(name)} samples"
                for graph in silent_graphs
                for name in BOARD_TOPICS
                if graph.sample_count(name) is not None
            ),
            *(f"telemetrix: pid {process.pid} state {process.state}: {process.command}" for process in processes),
            *((devices.serials or ("no /dev/ttyACM* and no /dev/ttyUSB*",)) if devices else ()),
            *kernel[-JOURNAL_LINES:],
            *errors[-JOURNAL_LINES:],
            *((vendor.line(),) if vendor else ()),
        ),
        command=f"unplug the board's USB cable and plug it in again, then: {restart}",
        explains={"battery-unreadable", *(f"topic-silent:{name}" for name in BOARD_TOPICS)},
    )


def find_battery_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The battery is low, or its state cannot be read and missions would not end in time."""
    for graph in visited_graphs(snapshot):
        if graph.battery is None:
            continue
        percentage, voltage = graph.battery
        charge = normalize(percentage)
        shown = "NaN" if percentage is None else f"{percentage:.3f}"
        volts = "NaN" if voltage is None else f"{voltage:.2f} V"
        line = f"{BATTERY.name} on {graph.name}: percentage {shown}, voltage {volts}"
        if charge is None:
            yield make_finding(
                "battery-unreadable",
                where=graph.machine,
                cause="the power watcher's percentage is not a number between 0 and 1 (or 0 and 100)",
                evidence=(line,),
                command=command_on_robot(snapshot, f"sudo systemctl restart {VENDOR}"),
            )
        elif charge < LOW_THRESHOLD:
            yield make_finding(
                "battery-low",
                where=graph.machine,
                cause=f"the battery is at {charge:.0%}, below {LOW_THRESHOLD:.0%}",
                evidence=(line,),
                command="charge the battery" if graph.kind == "robot" else "lupin sim --help",
            )


CHECKS = (
    Check(
        "board.motor",
        find_wedged_board,
        laptop=(GRAPH,),
        robot=(DEVICES, SYSTEM_JOURNAL, UNIT_STATES),
        followup_laptop=(GRAPH,),
    ),
    Check("board.battery", find_battery_faults, laptop=(GRAPH,)),
)
