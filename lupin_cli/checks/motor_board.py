"""The motor board behind telemetrix, and the battery."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.controllers import observed_graphs
from lupin_cli.checks.drive import SILENT_BUTTON
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import command_on_robot, restart_unit
from lupin_cli.checks.topic_delivery import BOARD_TOPICS, is_board_silent
from lupin_cli.facts.account import ACCOUNT, Account
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.units import UNIT_STATES, VENDOR
from lupin_runtime.graph import BATTERY
from lupin_runtime.safety.battery_monitor import LOW_THRESHOLD, normalize

# Words of kernel messages about a lost serial device. Drivers also name the device when they find it, which is no trouble.
SERIAL_TROUBLE = ("usb disconnect", "device descriptor read", "not accepting address", "unable to enumerate")
SERIAL_DEVICES, SERIAL_ERRORS = ("ttyacm", "ttyusb", "cdc_acm"), ("error", "fail", "timed out", "timeout", "disconnect", "lost")
TELEMETRIX_TROUBLE = ("serialexception", "serial", "telemetrix", "timed out")
JOURNAL_LINES = 5


def is_serial_trouble(text: str) -> bool:
    """Return whether a message of the kernel reports a lost or failing serial device."""
    lowered = text.lower()
    named = any(word in lowered for word in SERIAL_DEVICES) and any(word in lowered for word in SERIAL_ERRORS)
    return named or any(word in lowered for word in SERIAL_TROUBLE)


def find_wedged_board(snapshot: Snapshot) -> Iterator[Finding]:
    """telemetrix runs, but its board does not answer: commands have no effect, wheels spin freely."""
    devices = snapshot.robot_fact(DEVICES)
    journal = snapshot.robot_fact(SYSTEM_JOURNAL)
    units = snapshot.robot_fact(UNIT_STATES)
    vendor = units.get(VENDOR) if units else None
    silent_graphs = [graph for graph in observed_graphs(snapshot) if graph.kind == "robot" and is_board_silent(graph)]
    processes = devices.telemetrix if devices else ()
    kernel = [line.line for line in (journal.kernel if journal else ()) if is_serial_trouble(line.text)]
    # Every process that writes to a device is in state D for an instant; it counts only with a second sign.
    blocked_processes = [process for process in processes if process.state == "D" and (silent_graphs or kernel)]
    left_bus = bool(processes and devices and not devices.serials and any("disconnect" in line.lower() for line in kernel))
    if not (silent_graphs or blocked_processes or left_bus):
        return
    errors = [
        line.line
        for line in (journal.units if journal else ())
        if "telemetrix" in line.raw.lower() and any(word in line.text.lower() for word in TELEMETRIX_TROUBLE)
    ]
    if left_bus:
        cause = "the board left the USB bus, and telemetrix continues without it"
    elif blocked_processes:
        cause = "telemetrix hangs in the kernel, waiting for the board's serial port"
    else:
        cause = "telemetrix runs, but its board sends nothing"
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
        instruction="unplug the board's USB cable and plug it in again, then type the command",
        command=restart_unit(snapshot),
        # The board publishes the button's state, too.
        explains={"battery-unreadable", f"estop-engaged:{SILENT_BUTTON}", *(f"topic-silent:{name}" for name in BOARD_TOPICS)},
    )


def find_closed_serial_ports(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot's user may not open the serial port of a board, whatever its groups are."""
    devices, account = snapshot.robot_fact(DEVICES), snapshot.robot_fact(ACCOUNT)
    if devices is None or account is None or account.uid == 0:
        return
    closed = [line for line in devices.serials if not _may_open(line, account)]
    if closed:
        paths = " ".join(line.split()[0] for line in closed)
        yield make_finding(
            "serial-port-closed",
            where="robot",
            cause=f"{account.user} may not open {paths}: owner, group or mode are not those that udev gives",
            evidence=(*closed, f"id -Gn: {' '.join(account.groups)}"),
            command=command_on_robot(snapshot, f"sudo chown root:dialout {paths}; sudo chmod 660 {paths}"),
        )


def _may_open(line: str, account: Account) -> bool:
    """Return whether a member of dialout may read and write a port that `stat` prints as `/dev/ttyACM0 root:dialout 660`.

    That the user is no member is another finding.
    """
    words = line.split()
    if len(words) != 3 or ":" not in words[1] or not words[2].isdigit():
        return True
    (owner, group), mode = words[1].split(":", 1), int(words[2], 8)
    if owner == account.user:
        return mode & 0o600 == 0o600
    if group in {"dialout", *account.groups}:
        return mode & 0o060 == 0o060
    return mode & 0o006 == 0o006


def find_battery_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The battery is low, or its state cannot be read and missions would not end in time."""
    for graph in observed_graphs(snapshot):
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
                graph=graph.name,
                cause="the power watcher's percentage is not a number between 0 and 1 (or 0 and 100)",
                evidence=(line,),
                command=restart_unit(snapshot) if graph.kind == "robot" else "lupin logs sim",
            )
        elif charge < LOW_THRESHOLD:
            yield make_finding(
                "battery-low",
                where=graph.machine,
                graph=graph.name,
                cause=f"the battery is at {charge:.0%}, below {LOW_THRESHOLD:.0%}",
                evidence=(line,),
                instruction="charge the battery"
                if graph.kind == "robot"
                else "start the simulation again: its battery is charged at the start",
            )


CHECKS = (
    Check(
        "board.motor",
        find_wedged_board,
        laptop=(GRAPH,),
        robot=(DEVICES, SYSTEM_JOURNAL, UNIT_STATES),
        followup_laptop=(GRAPH,),
        followup_robot=(DEVICES,),  # a process is in state D for an instant whenever it writes
    ),
    Check("board.serial", find_closed_serial_ports, robot=(DEVICES, ACCOUNT)),
    Check("board.battery", find_battery_faults, laptop=(GRAPH,)),
)
