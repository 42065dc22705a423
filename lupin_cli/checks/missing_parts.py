"""Parts of the robot that nobody publishes for, although the rest of the robot is heard: their programs are gone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.drive import SILENT_BUTTON
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.layers import BASE_PART, BOARD_PART, DRIVE, EVERYTHING, LIDAR_PART, LUPIN, part_of
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.ros_processes import RosProcess
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.units import UNIT_STATES, VENDOR
from lupin_cli.systemd.units import AUTO_HOME, ONBOARD
from lupin_runtime.graph import topics

JOURNAL_LINES = 5
# Words of the programs of a part, as they occur in the journal of the unit that starts them.
_WORDS = {
    LIDAR_PART: ("lidar", "rplidar", "scan", "ttyusb"),
    BOARD_PART: ("telemetrix", "ttyacm", "serial"),
    BASE_PART: ("ros2_control", "controller_manager", "spawner"),
    LUPIN: ("lupin",),
}
_SIGNS = {
    BOARD_PART: frozenset({"board-wedged", f"estop-engaged:{SILENT_BUTTON}"}),
    BASE_PART: frozenset({"controllers-not-active", "controller-manager-missing", "controller-manager-silent"}),
    DRIVE: frozenset({"drive-sink-unheard"}),
}
_NEED_CONTROLLERS = frozenset({"drive-sink-unheard", f"oneshot-failed:{AUTO_HOME}"})
_VENDORS_PARTS = frozenset({BASE_PART, LIDAR_PART, BOARD_PART})
_ON_SERIAL_PORT = (LIDAR_PART, BOARD_PART)


def parts_in(text: str, parts: Iterable[str]) -> tuple[str, ...]:
    """Return those of the robot's parts whose programs a line names."""
    return tuple(part for part in parts if any(word in text.lower() for word in _WORDS.get(part, ())))


def losses_of(truth: ground_truth.GroundTruth, program: str, *, in_vendor_unit: bool = False) -> tuple[str, ...]:
    """Return what a broken program of the robot may have taken with it.

    That is everything if nothing arrives, or nothing of the unit's other programs; otherwise the program's own parts, or all
    parts of the unit if none of them is as it should be: each is silent, or slow because the program stops again and again.
    """
    broken = truth.state is ground_truth.State.BROKEN
    if not ground_truth.hears_robot(truth) or (in_vendor_unit and broken and not ground_truth.hears_vendor(truth)):
        return (EVERYTHING,)
    if in_vendor_unit and (EVERYTHING in truth.losses or set(truth.losses) >= _VENDORS_PARTS):
        return tuple(part for part in truth.losses if part != LUPIN)
    parts = parts_in(program, truth.losses)
    return (*parts, DRIVE) if DRIVE in truth.losses and {BASE_PART, LUPIN} & set(parts) else parts


def describe_programs(processes: Iterable[RosProcess]) -> str:
    """Return the names and command lines of processes, in which `parts_in` finds the parts that they belong to."""
    return " ".join(f"{process.name} {process.command}" for process in processes)


def signs_of_loss(losses: Iterable[str]) -> frozenset[str]:
    """Return the findings over DDS that show these losses."""
    lost = set(losses)
    if EVERYTHING in lost:
        return OVER_GRAPH
    silent = {f"topic-silent:{row.name}" for row in topics() if row.publishers and part_of(row) in lost}
    return frozenset(silent.union(*(_SIGNS.get(part, frozenset()) for part in lost)))


def find_missing_parts(snapshot: Snapshot) -> Iterator[Finding]:
    """Every topic of a part lacks a publisher, while other parts deliver: the part's program has died or was not started."""
    truth = ground_truth.measure(snapshot)
    if snapshot.robot is None or truth.state is not ground_truth.State.BROKEN or not truth.heard:
        return
    rows = {row.name: row for row in topics()}
    devices, journal = snapshot.robot_fact(DEVICES), snapshot.robot_fact(SYSTEM_JOURNAL)
    units = snapshot.robot_fact(UNIT_STATES)
    for part in truth.losses:
        reports = [each for each in truth.topics if each.required and part_of(rows[each.name]) == part]
        if not reports or any(each.state != ground_truth.MISSING for each in reports):
            continue
        name = ONBOARD if part == LUPIN else VENDOR
        unit = units.get(name) if units is not None else None
        if units is not None and units.systemd and (not unit.running if unit is not None else part == LUPIN):
            continue  # the state of its unit is a finding of its own
        has_unit = unit is not None or units is None or not units.systemd  # another image may start the stack otherwise
        look = f"systemctl restart {name}; sudo journalctl -b -u {name}" if has_unit else "journalctl -b"
        lines = [line for line in (journal.units if journal else ()) if parts_in(line.text, (part,))]
        serials = (devices.serials or ("no /dev/ttyACM* and no /dev/ttyUSB*",)) if devices and part in _ON_SERIAL_PORT else ()
        without_port = devices is not None and part in _ON_SERIAL_PORT and not devices.serials and bool(devices.usb)
        running = f"{name} runs and " if unit is not None else ""
        yield make_finding(
            "part-missing",
            where="robot",
            symptom=f"nothing publishes the data of {part}",
            cause=f"no program publishes for {part}, while {running}other parts are heard"
            + ("; the robot has no serial port for it" if without_port else ": it has died, or was not started"),
            evidence=(
                *(report.line() for report in reports),
                *serials,
                *((unit.line(),) if unit is not None else ()),
                *(line.line for line in lines[-JOURNAL_LINES:]),
            ),
            command=command_on_robot(snapshot, f"sudo {look} -n 50"),
            about=part,
            layer="devices" if without_port else "",
            # A board that does not answer is why its driver exits, not the other way round.
            explains=(signs_of_loss((part,)) - {"board-wedged"}) | (_NEED_CONTROLLERS if part == BASE_PART else frozenset()),
            breaks=(part,),
        )


CHECKS = (
    Check(
        "processes.missing",
        find_missing_parts,
        laptop=(GRAPH,),
        robot=(DEVICES, SYSTEM_JOURNAL, UNIT_STATES),
        followup_laptop=(GRAPH,),  # under load, names come late
    ),
)
