"""The motor board behind telemetrix, and the battery."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.controllers import observed_graphs
from lupin_cli.checks.drive import SILENT_BUTTON
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.layers import BOARD_PART
from lupin_cli.checks.remote_command import command_on_robot, restart_unit
from lupin_cli.checks.topic_delivery import BOARD_TOPICS, is_board_silent
from lupin_cli.facts.account import ACCOUNT, Account
from lupin_cli.facts.devices import DEVICES, Devices
from lupin_cli.facts.graph import GRAPH, Graph
from lupin_cli.facts.motor_board import MOTOR_BOARD, AskedPort
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.units import UNIT_STATES, VENDOR
from lupin_runtime.board_protocol import ANSWER_LIMIT_S, Answer
from lupin_runtime.graph import BATTERY, ODOM
from lupin_runtime.safety.battery_monitor import LOW_THRESHOLD, normalize

# Words of kernel messages about a lost serial device. Drivers also name the device when they find it, which is no trouble.
SERIAL_TROUBLE = ("usb disconnect", "device descriptor read", "not accepting address", "unable to enumerate")
SERIAL_DEVICES, SERIAL_ERRORS = ("ttyacm", "ttyusb", "cdc_acm"), ("error", "fail", "timed out", "timeout", "disconnect", "lost")
TELEMETRIX_TROUBLE = ("serialexception", "serial", "telemetrix", "timed out")
JOURNAL_LINES = 5
MOTOR_SUPPLY_V = 5.0  # a battery of three cells has 9 V at least; below this, the motors' supply is switched off
IDLE_WHEELS_S = 1.0
# What a board without data causes; it publishes the button's state, too.
BOARD_SIGNS = frozenset(
    {"battery-unreadable", f"estop-engaged:{SILENT_BUTTON}", *(f"topic-silent:{name}" for name in BOARD_TOPICS)}
)
# What the vendor's driver prints before it exits because the board does not answer; it is started again after 5 s.
GIVEN_UP = ("missed pings", "no ports available", "get_feature probably stuck")


def is_serial_trouble(text: str) -> bool:
    """Return whether a message of the kernel reports a lost or failing serial device."""
    lowered = text.lower()
    named = any(word in lowered for word in SERIAL_DEVICES) and any(word in lowered for word in SERIAL_ERRORS)
    return named or any(word in lowered for word in SERIAL_TROUBLE)


def has_board_port(devices: Devices) -> bool:
    """Return whether there is a serial port of the kind that the board has; the lidar's is /dev/ttyUSB*."""
    return any(line.startswith("/dev/ttyACM") for line in devices.serials)


def _kernel_trouble(snapshot: Snapshot) -> list[str]:
    journal = snapshot.robot_fact(SYSTEM_JOURNAL)
    return [line.line for line in (journal.kernel if journal else ()) if is_serial_trouble(line.text)]


def has_left_bus(snapshot: Snapshot) -> bool:
    """Return whether the driver runs, and the board has left the USB bus since it started."""
    devices = snapshot.robot_fact(DEVICES)
    disconnected = any("disconnect" in line.lower() for line in _kernel_trouble(snapshot))
    return devices is not None and bool(devices.telemetrix) and not has_board_port(devices) and disconnected


def find_wedged_board(snapshot: Snapshot) -> Iterator[Finding]:
    """The board does not answer: commands have no effect, wheels spin freely."""
    devices, board = snapshot.robot_fact(DEVICES), snapshot.robot_fact(MOTOR_BOARD)
    journal = snapshot.robot_fact(SYSTEM_JOURNAL)
    units = snapshot.robot_fact(UNIT_STATES)
    vendor = units.get(VENDOR) if units else None
    stack_runs = vendor is None or vendor.running  # a stopped stack publishes nothing, whatever its board does
    silent_graphs = [
        graph for graph in observed_graphs(snapshot) if graph.kind == "robot" and stack_runs and is_board_silent(graph)
    ]
    idle = [graph for graph in observed_graphs(snapshot) if stack_runs and _has_idle_wheels(graph)]
    processes = devices.telemetrix if devices else ()
    kernel = _kernel_trouble(snapshot)
    # Every process that writes to a device is in state D for an instant; it counts only with a second sign.
    blocked_processes = [process for process in processes if process.state == "D" and (silent_graphs or kernel)]
    left_bus = has_left_bus(snapshot)
    unanswered = [asked for asked in (board.asked if board else ()) if _no_answer(asked)]
    given_up = _given_up(snapshot)
    if not (silent_graphs or blocked_processes or left_bus or unanswered or given_up or idle):
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
    elif unanswered:
        cause = _no_answer(unanswered[0])
    elif given_up:
        cause = "telemetrix gets no answer from the board, exits, and is started again"
    elif silent_graphs:
        cause = "telemetrix runs, but its board sends nothing"
    else:
        cause = "the encoders are silent while the wheels are commanded: the board does not execute commands"
    only_idle = not (silent_graphs or blocked_processes or left_bus or unanswered or given_up)
    yield make_finding(
        "board-wedged",
        where="robot",
        cause=cause,
        evidence=(
            *(line for asked in unanswered for line in asked.lines()),
            *(
                f"{name}: {graph.sample_count(name)} samples"
                for graph in silent_graphs
                for name in BOARD_TOPICS
                if graph.sample_count(name) is not None
            ),
            *(
                f"{ODOM.name} on {graph.name}: unchanged for {graph.idle_wheels_s:.1f} s, while the input "
                f"{graph.drive_bus_holder} drove"
                for graph in idle
            ),
            *(f"telemetrix: pid {process.pid} state {process.state}: {process.command}" for process in processes),
            *((devices.serials or ("no /dev/ttyACM* and no /dev/ttyUSB*",)) if devices else ()),
            *kernel[-JOURNAL_LINES:],
            *errors[-JOURNAL_LINES:],
            *given_up[-JOURNAL_LINES:],
            *((vendor.line(),) if vendor else ()),
        ),
        instruction=("if nothing blocks the wheels and the motors have power, " if only_idle else "")
        + "unplug the board's USB cable and plug it in again, then type the command",
        command=restart_unit(snapshot),
        playbook="" if left_bus else None,
        explains=BOARD_SIGNS,
        breaks=() if only_idle else None,  # battery and button may be heard
    )


def _has_idle_wheels(graph: Graph) -> bool:
    """Return whether the drive bus of a robot passes commands to a controller, and the wheels do not turn.

    Wheels without power are another finding.
    """
    volts = graph.battery[1] if graph.battery is not None else None
    return (
        graph.kind == "robot"
        and graph.idle_wheels_s >= IDLE_WHEELS_S
        and bool(graph.drive_bus_holder)
        and not graph.drive_bus_locks
        and any(listeners for _, listeners in graph.sink_subscriptions)
        and (volts is None or volts >= MOTOR_SUPPLY_V)
    )


def _given_up(snapshot: Snapshot) -> list[str]:
    """Return the last words of drivers that have given up a board which is on the USB, while its data is missing."""
    board, journal = snapshot.robot_fact(MOTOR_BOARD), snapshot.robot_fact(SYSTEM_JOURNAL)
    if board is None or journal is None or not board.serial_ports or BOARD_PART not in ground_truth.measure(snapshot).losses:
        return []
    return [line.line for line in journal.units if any(words in line.text.lower() for words in GIVEN_UP)]


def _no_answer(asked: AskedPort) -> str:
    """Return how a board that was asked fails to answer; empty if it answers, or was not asked."""
    found = asked.examination
    if found is None or found.answer not in (Answer.SILENT, Answer.LATE):
        return ""
    if found.answer is Answer.LATE and found.answered_s is not None:
        return f"the board answers after {found.answered_s:.1f} s, and the vendor's driver waits for {ANSWER_LIMIT_S:g} s"
    return f"the board's port opens, and the board answers nothing{f': {asked.failed}' if asked.failed else ''}"


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
        robot=(DEVICES, MOTOR_BOARD, SYSTEM_JOURNAL, UNIT_STATES),
        followup_laptop=(GRAPH,),
        followup_robot=(DEVICES,),  # a process is in state D for an instant whenever it writes
    ),
    Check("board.serial", find_closed_serial_ports, robot=(DEVICES, ACCOUNT)),
    Check("board.battery", find_battery_faults, laptop=(GRAPH,)),
)
