"""The table of findings. Everything that lists checks or findings is derived from it.

`checks/table.py` loads the modules that it names, `make_finding` takes severity, symptom and playbook from it, and
`tools/write_docs.py` writes the table of docs/doctor.md. To add a check, write its module, add a row for each of its
findings, and add a captured output of the probe whose fact it judges.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from lupin_cli.checks.base import Finding, Fix, Severity
from lupin_cli.checks.layers import BASE_PART, BOARD_PART, DRIVE, EVERYTHING, LIDAR_PART, LUPIN, STAMPS


@dataclass(frozen=True)
class FindingRow:
    """One kind of finding: which check returns it, what the operator sees, and what `--fix` does."""

    id: str
    module: str  # in lupin_cli.checks
    check: str
    symptom: str
    severity: Severity = Severity.PROBLEM
    playbook: str = ""  # what `--fix` plays; empty: a person types the finding's command
    safe: bool = False  # the playbook is played without asking
    fix_note: str = ""  # for the manual: in which cases `--fix` does something else
    over_dds: bool = False  # it is observed over DDS: a broken link or discovery explains it
    in_vendor_unit: bool = False  # it concerns what the vendor's service runs: that the service is down explains it
    layer: str = ""  # where on the path the fault is; empty: that of most findings of its module
    breaks: tuple[str, ...] = ()  # the parts of `checks.layers` whose data does not arrive any more

    @property
    def path_layer(self) -> str:
        """The layer to which the finding belongs."""
        return self.layer or _LAYERS_OF_MODULES[self.module]


_LAYERS_OF_MODULES = {
    "link": "carrier",
    "wifi": "route",
    "own_networks": "address",
    "discovery": "discovery",
    "multihoming": "route",
    "dds_environment": "environment",
    "shell_environment": "environment",
    "profiles": "profile",
    "stale_resources": "shared-memory",
    "ports": "processes",
    "software": "release",
    "unit_environment": "environment",
    "services": "processes",
    "clocks": "clock",
    "topic_delivery": "samples",
    "controllers": "processes",
    "drive": "samples",
    "board_port": "devices",
    "motor_board": "devices",
    "cameras": "devices",
    "resources": "machine",
    "ground_truth": "samples",
    "path": "ports",
    "missing_parts": "processes",
    "runs": "processes",
}
_ALL = (EVERYTHING,)
_NO_GRAPH = (
    "ros2 topic list shows only /parameter_events and /rosout, panels of the page are blank; the vendor's unit is active"
)
_NOT_DRIVING = "the robot does not drive, neither by joystick nor page nor navigation"
_PROFILE = "names or topics of the robot are missing, without any error"
_IF_CLOCK_WRONG = "only while the clock is wrong, or was not measured; otherwise restart the vendor's unit by hand"

# In the order in which a person would look for the cause: link, discovery, processes, the rest. Checks run in the order of
# their modules.
# fmt: off
FINDINGS: tuple[FindingRow, ...] = (
    FindingRow("unexplained", "ground_truth", "ground-truth", "this machine lacks data of the robot", over_dds=True,
        in_vendor_unit=True),
    FindingRow("part-missing", "missing_parts", "processes.missing", "a part of the robot is not in the graph", over_dds=True,
        in_vendor_unit=True),
    FindingRow("no-carrier", "link", "link.carrier", "the robot does not answer over the cable", breaks=_ALL),
    FindingRow("wifi-roamed", "wifi", "link.roam",
        "the robot stops driving, its controllers seem dead; ssh says: No route to host", layer="route", breaks=_ALL),
    FindingRow("wifi-may-roam", "wifi", "link.roam-risk", "the link drops during operation, although nothing was changed",
        severity=Severity.WARNING, playbook="pin-wifi", safe=True, layer="route"),
    FindingRow("network-conflict", "own_networks", "link.own-networks",
        "the robot does not answer, or another machine seems to be at its address", layer="address", breaks=_ALL),
    FindingRow("address-missing", "path", "path.packets", "no packet reaches the other machine", layer="address", breaks=_ALL),
    FindingRow("route-elsewhere", "path", "path.packets", "packets leave on a network that the other machine is not on",
        layer="route", breaks=_ALL),
    FindingRow("no-route", "path", "path.packets", "no packet reaches the other machine", layer="route", breaks=_ALL),
    FindingRow("neighbor-wrong", "path", "path.packets", "no packet reaches the other machine", layer="address", breaks=_ALL),
    FindingRow("link-dead", "path", "path.packets", "nothing passes, although both ends have a carrier", layer="carrier",
        breaks=_ALL),
    FindingRow("large-packets-lost", "path", "path.packets", "names appear, and large messages never arrive", layer="mtu",
        breaks=_ALL),
    FindingRow("packets-lost", "path", "path.packets", "topics stutter, services answer late or never", layer="loss",
        breaks=_ALL),
    FindingRow("udp-lost", "path", "path.packets", "ROS data of one direction or of some ports never arrives", breaks=_ALL),
    FindingRow("socket-not-read", "path", "path.sockets", "a program is listed and does nothing", layer="processes",
        over_dds=True, breaks=_ALL),
    FindingRow("robot-unreachable", "link", "link.reachable",
        "the robot does not answer: no topics, blank panels, dead controllers"),
    FindingRow("discovery-server-missing", "discovery", "discovery.server", _NO_GRAPH, playbook="recover-discovery", safe=True,
        in_vendor_unit=True, breaks=_ALL),
    FindingRow("discovery-server-switched-off", "discovery", "discovery.server", _NO_GRAPH, breaks=_ALL),
    FindingRow("discovery-port-taken", "discovery", "discovery.server", _NO_GRAPH, breaks=_ALL),
    FindingRow("discovery-server-stopped", "discovery", "discovery.server", _NO_GRAPH, breaks=_ALL),
    FindingRow("discovery-server-pinned", "discovery", "discovery.server",
        "the graph is visible on one network only; over the other, ros2 topic list shows only /parameter_events and /rosout",
        breaks=_ALL),
    FindingRow("discovery-server-other-id", "discovery", "discovery.server", _NO_GRAPH, breaks=_ALL),
    FindingRow("robot-multi-homed", "multihoming", "dds.multi-homed",
        "telemetry arrives, commands do not: the base does not drive, arm services and list_controllers time out",
        playbook="single-home", breaks=_ALL),
    FindingRow("process-older-than-interface", "multihoming", "dds.older-than-interface",
        "nodes are listed, but none of their data arrives over this link", breaks=_ALL),
    FindingRow("process-multicast-only", "dds_environment", "dds.processes",
        "a process runs but receives no telemetry; a program started in a new terminal receives it"),
    FindingRow("process-wrong-server", "dds_environment", "dds.wrong-server",
        "a process runs but receives nothing from the robot"),
    FindingRow("rmw-mismatch", "dds_environment", "dds.middleware",
        "a process and the other nodes do not receive each other's data"),
    FindingRow("dds-not-set-up", "shell_environment", "dds.shell",
        "ros2 topic list shows only /parameter_events and /rosout in every terminal of the laptop", severity=Severity.WARNING,
        breaks=_ALL),
    FindingRow("source-order", "shell_environment", "dds.shell",
        "ros2 topic list shows only /parameter_events and /rosout, although the terminal's startup file sources ros-env.sh",
        breaks=_ALL),
    FindingRow("shell-multicast-only", "shell_environment", "dds.shell",
        "ros2 topic list shows only /parameter_events and /rosout in this terminal", severity=Severity.WARNING, breaks=_ALL),
    FindingRow("shell-without-profile", "shell_environment", "dds.shell",
        "ros2 topic list shows only /parameter_events and /rosout in this terminal", severity=Severity.WARNING, breaks=_ALL),
    FindingRow("shell-rmw-mismatch", "shell_environment", "dds.shell",
        "programs started in this terminal and the robot do not receive each other's data", severity=Severity.WARNING,
        breaks=_ALL),
    FindingRow("shell-other-graph", "shell_environment", "dds.shell",
        "programs started in this terminal receive nothing from the robot", breaks=_ALL),
    FindingRow("shell-wrong-server", "shell_environment", "dds.shell-server",
        "programs started in this terminal receive nothing from the robot", breaks=_ALL),
    FindingRow("shell-program-fails", "shell_environment", "dds.shell-program",
        "every ROS program that is started in this terminal exits at once", breaks=_ALL),
    FindingRow("stale-daemon", "shell_environment", "dds.daemon",
        "ros2 topic list and ros2 topic echo show different graphs in the same terminal", severity=Severity.WARNING),
    FindingRow("profile-unreadable", "profiles", "dds.profiles", _PROFILE),
    FindingRow("profile-not-default", "profiles", "dds.profiles", _PROFILE),
    FindingRow("profile-not-super-client", "profiles", "dds.profiles", _PROFILE),
    FindingRow("profile-wrong-prefix", "profiles", "dds.profiles", _PROFILE),
    FindingRow("profile-without-server", "profiles", "dds.profiles", _PROFILE),
    FindingRow("profile-excludes-link", "profiles", "dds.profiles", _PROFILE),
    FindingRow("profile-wrong-address", "profiles", "dds.profiles", _PROFILE),
    FindingRow("profile-changed", "profiles", "dds.profile-age",
        "the profile is right, and a process behaves as if it were not", severity=Severity.WARNING),
    FindingRow("process-stopped", "stale_resources", "processes.stopped",
        "topics are listed and silent, services do not answer, while every unit is active", playbook="resume-process",
        layer="processes", breaks=_ALL),
    FindingRow("zombie-process", "stale_resources", "dds.zombies",
        "a new node sees the topics but gets no sample, or a service call gets two responses", playbook="sweep", safe=True,
        layer="processes"),
    FindingRow("shared-memory-not-shared", "stale_resources", "dds.shared-memory",
        "a late subscriber sees every topic name but gets no sample"),
    FindingRow("shared-memory-at-risk", "stale_resources", "dds.memory-at-risk",
        "the robot works until somebody logs in and out; after that, late joiners see names and get no samples",
        severity=Severity.WARNING, playbook="keep-shared-memory", safe=True),
    FindingRow("shared-memory-removed", "stale_resources", "dds.removed-memory",
        "nodes that join now see every name but get no sample; nodes that joined before receive each other's data",
        playbook="keep-shared-memory"),
    FindingRow("shared-memory-orphans", "stale_resources", "dds.orphans", "a new node starts and never completes discovery",
        severity=Severity.WARNING, playbook="sweep", safe=True),
    FindingRow("port-8090-taken", "ports", "ports", "the operator's page does not start: Address already in use"),
    FindingRow("port-9090-taken", "ports", "ports", "the page cannot reach the graph (rosbridge): Address already in use"),
    FindingRow("port-123-taken", "ports", "ports", "the NTP server for the robot does not start: Address already in use"),
    FindingRow("port-8091-taken", "ports", "ports", "the robot's cameras deliver no images: Address already in use"),
    FindingRow("python-missing", "software", "software.release", "no part of Lupin can run on the robot",
        breaks=(LUPIN, DRIVE)),
    FindingRow("not-deployed", "software", "software.release", "without the laptop there is no drive bus, e-stop or home pose",
        severity=Severity.WARNING, playbook="deploy-robot", layer="release"),
    FindingRow("release-broken", "software", "software.release", "Lupin's units fail at start", playbook="deploy-robot",
        breaks=(LUPIN, DRIVE)),
    FindingRow("python-changed", "software", "software.release", "Lupin's units fail at start with ModuleNotFoundError",
        playbook="deploy-robot", breaks=(LUPIN, DRIVE)),
    FindingRow("version-skew", "software", "software.release", "services and topics of robot and laptop may not match",
        severity=Severity.WARNING, playbook="deploy-robot"),
    FindingRow("release-damaged", "software", "software.release-files",
        "Lupin's units refuse to start, or a part of Lupin crashes at a late import", playbook="deploy-robot",
        breaks=(LUPIN, DRIVE)),
    FindingRow("release-unsigned", "software", "software.release-files", "nothing shows whether the release is undamaged",
        severity=Severity.WARNING, playbook="deploy-robot"),
    FindingRow("groups-missing", "software", "software.groups", "'Permission denied' on cameras, motor board or gamepad",
        severity=Severity.WARNING, layer="login"),
    FindingRow("home-not-writable", "software", "software.home", "the vendor's environment script and every ROS log fail",
        layer="login"),
    FindingRow("unit-environment", "unit_environment", "units.environment",
        "a unit of the robot is down, or the laptop receives nothing from what it runs", breaks=_ALL),
    FindingRow("process-environment", "unit_environment", "units.processes",
        "nodes of the robot run, but the laptop receives nothing from them", breaks=_ALL),
    FindingRow("unit-frozen", "services", "units.frozen", "topics are listed and silent, while every unit is active",
        breaks=_ALL),
    FindingRow("unit-without-network", "services", "units.network",
        "a unit of the robot runs, but the laptop receives nothing from it", breaks=_ALL),
    FindingRow("vendor-service-down", "services", "units.vendor",
        "no controllers, no lidar, no battery state, no discovery server", playbook="heal", breaks=_ALL),
    FindingRow("unit-missing", "services", "units.lupin", "parts of Lupin do not start with the robot",
        playbook="deploy-robot"),
    FindingRow("oneshot-failed", "services", "units.lupin", "controllers are stuck and the arm is not at its home pose",
        playbook="heal", fix_note="only for lupin-auto-home; lupin-clock-sync by hand", in_vendor_unit=True),
    FindingRow("unit-start-limit", "services", "units.lupin", "a part of Lupin is down, and systemd does not start it again",
        playbook="start-onboard", safe=True, fix_note="only for lupin-onboard; other units by hand"),
    FindingRow("unit-failed", "services", "units.lupin", "a part of Lupin is down", playbook="start-onboard", safe=True,
        fix_note="only for lupin-onboard; other units by hand", in_vendor_unit=True),
    FindingRow("unit-restarting", "services", "units.lupin", "a part of Lupin fails and is restarted again and again",
        in_vendor_unit=True),
    FindingRow("unit-not-running", "services", "units.lupin", "a part of Lupin is down", playbook="start-onboard", safe=True,
        fix_note="only for lupin-onboard; other units by hand", in_vendor_unit=True),
    FindingRow("unit-starting", "services", "units.lupin", "a part of Lupin is down: systemd waits until it has started",
        over_dds=True, in_vendor_unit=True, breaks=(LUPIN, DRIVE)),
    FindingRow("unit-not-enabled", "services", "units.lupin", "a part of the robot does not start at the next boot",
        severity=Severity.WARNING),
    FindingRow("unit-outlived-vendor", "services", "units.together",
        "after a restart of the robot's stack, commands have no effect while everything looks alive", playbook="deploy-robot",
        fix_note="only if the unit's file lacks PartOf=mirte-ros.service; otherwise restart the unit by hand",
        breaks=(LUPIN, DRIVE)),
    FindingRow("run-interrupted", "runs", "runs.interrupted", "a machine is half way between two states",
        severity=Severity.WARNING),
    FindingRow("units-need-reload", "services", "units.reload", "a change to a unit file has no effect",
        severity=Severity.WARNING),
    FindingRow("clock-drift", "clocks", "clock.drift",
        "the map stops (Message Filter dropping message); transforms are too old or from the future", playbook="sync-clock",
        fix_note="without asking while the stack is down; up to 3 s, chrony slews a running stack's clock; a person if either "
        "clock may be wrong",
        breaks=(STAMPS,)),
    FindingRow("chrony-stock-makestep", "clocks", "clock.makestep",
        "controllers die without an error minutes after boot, as soon as a time source is reachable", severity=Severity.WARNING,
        playbook="install-clock-sync", safe=True),
    FindingRow("chrony-missing", "clocks", "clock.robot",
        "after every boot the clock is as wrong as it was at the last shutdown"),
    FindingRow("chrony-not-running", "clocks", "clock.robot",
        "the clock drifts by seconds a day, and by hours over a power-off: there is no hardware clock",
        severity=Severity.WARNING, fix_note="if chrony is allowed to step the clock, asks, then plays `install-clock-sync`"),
    FindingRow("other-time-daemon", "clocks", "clock.robot",
        "the clock is stepped while the stack runs, or is as wrong after a boot as it was at the last shutdown",
        severity=Severity.WARNING),
    FindingRow("chrony-sources-silent", "clocks", "clock.robot", "the robot's clock follows no time source",
        severity=Severity.WARNING, playbook="serve-clock"),
    FindingRow("chrony-not-serving", "clocks", "clock.laptop",
        "the robot's clock stays wrong after a boot, although its clock-sync unit is installed", severity=Severity.WARNING,
        playbook="serve-clock"),
    FindingRow("type-mismatch", "topic_delivery", "graph.qos", "a subscriber never gets a message, without any error",
        layer="endpoints"),
    FindingRow("qos-mismatch", "topic_delivery", "graph.qos", "a subscriber never gets a message, without any error",
        layer="endpoints"),
    FindingRow("frame-wrong", "topic_delivery", "graph.headers",
        "the map does not grow, or grows turned or shifted; transforms of the frame do not exist", over_dds=True),
    FindingRow("stamps-wrong", "topic_delivery", "graph.headers",
        "the map stops (Message Filter dropping message); transforms are too old or from the future", over_dds=True,
        breaks=(STAMPS,)),
    FindingRow("names-no-samples", "topic_delivery", "graph.samples",
        "every topic is listed but no sample arrives, though the robot's own nodes work", over_dds=True, breaks=_ALL),
    FindingRow("one-way-data", "topic_delivery", "graph.asymmetry",
        "telemetry arrives, but no drive command, arm service or controller call gets through", playbook="single-home",
        over_dds=True, breaks=_ALL),
    FindingRow("topic-silent", "topic_delivery", "graph.silent", "everything that needs the topic waits for it", over_dds=True,
        in_vendor_unit=True),
    FindingRow("camera-silent", "topic_delivery", "graph.cameras", "a camera's image is black or frozen", over_dds=True,
        in_vendor_unit=True),
    FindingRow("graph-not-visited", "topic_delivery", "graph.visit",
        "programs on the laptop, or only the doctor, cannot join the graph", severity=Severity.WARNING, over_dds=True,
        breaks=_ALL),
    FindingRow("controllers-not-active", "controllers", "controllers.states",
        "the base does not drive, or arm and gripper do not move, without any error", playbook="heal", over_dds=True,
        in_vendor_unit=True, breaks=(BASE_PART, DRIVE)),
    FindingRow("controller-manager-missing", "controllers", "controllers.manager",
        "wheels, arm and gripper are dead; the lidar may still work", playbook="sync-clock", over_dds=True, in_vendor_unit=True,
        breaks=(BASE_PART, DRIVE)),
    FindingRow("controller-manager-silent", "controllers", "controllers.manager",
        "wheels, arm and gripper are dead although every topic is listed", playbook="sync-clock", over_dds=True,
        in_vendor_unit=True, breaks=(BASE_PART, DRIVE)),
    FindingRow("drive-sink-unheard", "drive", "drive.sink", "the robot ignores every drive command, without any error",
        over_dds=True, in_vendor_unit=True, layer="endpoints", breaks=(DRIVE,)),
    FindingRow("estop-engaged", "drive", "drive.estop", _NOT_DRIVING),
    FindingRow("bus-locked", "drive", "drive.locks", _NOT_DRIVING),
    FindingRow("drive-bypassed", "drive", "drive.publishers",
        "the robot moves without a command, or the e-stop does not stop it"),
    FindingRow("estop-forged", "drive", "drive.publishers", "the e-stop is released, and the robot does not drive"),
    FindingRow("page-holds-bus", "drive", "drive.inputs",
        "navigation has a goal and the robot stands still: an open page holds the drive bus", severity=Severity.WARNING),
    FindingRow("pad-holds-bus", "drive", "drive.inputs",
        "navigation has a goal and the robot stands still: the gamepad holds the drive bus", severity=Severity.WARNING),
    FindingRow("board-held", "board_port", "board.holder",
        "wheels ignore commands, or obey some of them; battery, IMU and red button publish nothing", breaks=(BOARD_PART,)),
    FindingRow("board-firmware-wrong", "board_port", "board.firmware",
        "wheels, battery, IMU and red button are dead after a change of the board or its firmware", breaks=(BOARD_PART,)),
    FindingRow("board-unpowered", "board_port", "board.power",
        "wheels ignore commands and can be turned by hand, although everything else works", breaks=(BOARD_PART,)),
    FindingRow("board-absent", "board_port", "board.presence",
        "wheels, battery, IMU and red button are dead; 'No ports available' in the system journal", breaks=(BOARD_PART,)),
    FindingRow("board-wedged", "motor_board", "board.motor",
        "wheels spin freely and ignore commands; battery, IMU and red button publish nothing", playbook="recover-board",
        fix_note="not if the board has left the USB bus", breaks=(BOARD_PART,)),
    FindingRow("serial-port-closed", "motor_board", "board.serial",
        "wheels, battery, IMU and lidar are dead; 'Permission denied' in the system journal", breaks=(BOARD_PART, LIDAR_PART)),
    FindingRow("battery-unreadable", "motor_board", "board.battery", "a mission does not end when the battery runs low",
        severity=Severity.WARNING),
    FindingRow("battery-low", "motor_board", "board.battery",
        "missions return to the dock; servos and single-board computer brown out"),
    FindingRow("camera-held", "cameras", "cameras",
        "black or missing camera images; 'Device or resource busy' in the system journal"),
    FindingRow("camera-absent", "cameras", "cameras.drivers", "no images from a camera"),
    FindingRow("camera-driver-missing", "cameras", "cameras.drivers", "no images from a camera"),
    FindingRow("camera-driver-failing", "cameras", "cameras.drivers", "no images from a camera, or interrupted ones"),
    FindingRow("filesystem-read-only", "resources", "machine.storage", "logs stop, settings are lost, a deploy fails"),
    FindingRow("shared-memory-full", "resources", "machine.storage", "new nodes see names and get no samples, or die at start",
        playbook="sweep", layer="machine"),
    FindingRow("disk-full", "resources", "machine.storage", "logs stop, a deploy fails, services that write die at start"),
    FindingRow("inodes-used-up", "resources", "machine.storage", "'No space left on device' although there is space"),
    FindingRow("memory-low", "resources", "machine.memory", "everything stutters; soon the kernel kills a process"),
    FindingRow("killed-for-memory", "resources", "machine.memory", "a process vanished without an error",
        severity=Severity.WARNING),
    FindingRow("socket-buffers-small", "resources", "machine.socket-buffers",
        "large messages arrive rarely or never, images stutter", severity=Severity.WARNING, layer="loss"),
    FindingRow("under-voltage", "resources", "machine.heat", "USB devices drop out, the board resets, the SD card loses data"),
    FindingRow("too-hot", "resources", "machine.heat", "nodes publish too slowly, images and scans come late"),
)
# fmt: on
_BY_ID: Mapping[str, FindingRow] = {row.id: row for row in FINDINGS}
OVER_GRAPH = frozenset(row.id for row in FINDINGS if row.over_dds)
NEED_VENDOR = frozenset(row.id for row in FINDINGS if row.in_vendor_unit)


def modules() -> tuple[str, ...]:
    """Return the modules with Lupin's own checks, in the order in which the checks run."""
    return tuple(f"lupin_cli.checks.{name}" for name in dict.fromkeys(row.module for row in FINDINGS))


def make_finding(
    id: str,
    *,
    where: str,
    cause: str,
    evidence: Iterable[str],
    command: str = "",
    instruction: str = "",
    playbook: str | None = None,
    variables: Mapping[str, Any] | None = None,
    safe: bool | None = None,
    severity: Severity | None = None,
    symptom: str = "",
    explains: Iterable[str] = (),
    about: str = "",
    blocks_playbooks: Iterable[str] = (),
    graph: str = "",
    layer: str = "",
    breaks: Iterable[str] | None = None,
) -> Finding:
    """Build the finding `id`. What its row also has comes from there unless it is passed.

    `where` is the machine, `about` its unit, topic or process if several can have this fault. `explains` lists the findings
    that disappear together with this one, `blocks_playbooks` the playbooks that fail until it is fixed. `command` is a line
    for a shell of the laptop, `instruction` what a person does by hand or must know; pass `playbook=""` if only a person can
    fix this case. `graph` is the ROS graph's name, if the finding was observed on one. Raises KeyError for an id without a row.
    """
    row = _BY_ID[id]
    chosen_playbook = row.playbook if playbook is None else playbook
    is_safe = row.safe if safe is None else safe
    return Finding(
        id=id,
        severity=severity or row.severity,
        where=where,
        symptom=symptom or row.symptom,
        cause=cause,
        evidence=tuple(evidence),
        fix=Fix(command, chosen_playbook, dict(variables or {}), is_safe and bool(chosen_playbook), instruction),
        explains=frozenset(explains) | _explained_losses(row.breaks if breaks is None else breaks),
        about=about,
        blocks_playbooks=frozenset(blocks_playbooks),
        graph=graph,
        layer=layer or row.path_layer,
    )


def _explained_losses(parts: Iterable[str]) -> frozenset[str]:
    """Return what a finding explains that takes away the data of these parts of the robot."""
    names = ("unexplained", "part-missing")
    return frozenset(name if part == EVERYTHING else f"{name}:{part}" for part in parts for name in names)
