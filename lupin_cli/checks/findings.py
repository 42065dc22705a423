"""The table of findings. Everything that lists checks or findings is derived from it.

`checks/table.py` loads the modules that it names, `make_finding` takes severity, symptom and playbook from it, and
`tools/write_docs.py` writes the table of docs/doctor.md. To add a check, write its module, add a row for each of its
findings, and add a captured output of the fact that it judges.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from lupin_cli.checks.base import Finding, Fix, Severity

# Tests that cause the fault on a booted robot or on a graph of real nodes.
_LINK = "tests/lupin_cli/doctor/test_doctor_on_host.py"
_SETUP = "tests/lupin_cli/doctor/test_setup_on_host.py"
_HEALTH = "tests/lupin_cli/checks/test_checks_on_host.py"
_CAMERAS = "tests/lupin_cli/systemd/test_cameras_on_host.py"
_GRAPH = "tests/lupin_cli/checks/test_graph_checks_on_host.py"
_PROBE = "tests/lupin_runtime/stack/test_graph_probe.py"
# Tests that judge output captured from a machine.
_NETWORK_CAPTURES = "tests/lupin_cli/checks/test_network_checks.py"
_CASES = "tests/lupin_cli/checks/test_captured_cases.py"
_GRAPH_CAPTURES = "tests/lupin_cli/checks/test_graph_checks.py"


@dataclass(frozen=True)
class FindingRow:
    """One kind of finding: which check returns it, what the operator sees, which test proves it, and what `--fix` does."""

    id: str
    module: str  # in lupin_cli.checks
    check: str
    symptom: str
    proof: str  # file::test
    severity: Severity = Severity.PROBLEM
    playbook: str = ""  # what `--fix` plays; empty: a person types the finding's command
    safe: bool = False  # the playbook is played without asking
    note: str = ""  # for the manual: limits of the proof or of the fix
    over_graph: bool = False  # it is observed over DDS: a broken link or discovery explains it
    needs_vendor: bool = False  # it concerns what the vendor's service runs: that the service is down explains it

    @property
    def captured(self) -> bool:
        """Whether the proof judges captured output instead of causing the fault."""
        return self.proof.partition("::")[0] in (_NETWORK_CAPTURES, _CASES, _GRAPH_CAPTURES)


_NO_GRAPH = "ros2 topic list returns 2; the page loads and every panel is blank, while the vendor's unit is active"
_NOT_DRIVING = "nothing drives: joystick, page and navigation alike"
_PROFILE = "names or topics of the robot are missing, without any error"
_UNREACHABLE = f"{_LINK}::test_unreachable_robot_is_named_by_its_failure"
_BAD_SERVER = f"{_LINK}::test_unusable_discovery_server_is_the_only_root_cause"
_BAD_SHELL = f"{_SETUP}::test_each_shell_fault_is_the_only_root_cause"
_BAD_PROFILE = f"{_SETUP}::test_each_profile_fault_is_the_only_root_cause"
_NO_SERVER = f"{_SETUP}::test_profile_without_server_is_the_only_root_cause"
_LOGIND = f"{_LINK}::test_logind_removes_shared_memory_until_fixed"
_PORT = f"{_LINK}::test_foreign_program_on_console_port_is_named"
_RELEASE = f"{_HEALTH}::test_broken_and_mismatched_release_are_named"
_PREREQUISITE = f"{_HEALTH}::test_missing_prerequisites_of_lupin_are_named"
_STOPPED_UNIT = f"{_HEALTH}::test_start_limit_differs_from_stopped_unit"
_FAILED_UNIT = f"{_HEALTH}::test_failed_unit_differs_from_restarting_unit"
_TIME_SOURCE = f"{_HEALTH}::test_silent_time_source_and_missing_chrony_are_named"
_DISK = f"{_HEALTH}::test_full_disk_and_read_only_disk_are_named"
_CAPTURED_CASE = f"{_CASES}::test_captured_fault_is_named_alone"
_SILENT = f"{_GRAPH}::test_silent_sensor_and_silent_board_are_distinguished"
_GRAPH_FAULTS = f"{_GRAPH}::test_simultaneous_graph_faults_are_each_named"
_ZEROS = f"{_GRAPH}::test_gamepad_zeros_and_type_mismatch_are_named"
_REAL_NODES = f"{_PROBE}::test_faults_of_real_nodes_give_exactly_their_findings"
_CAMERA_FAULTS = f"{_CAMERAS}::test_each_fault_of_a_camera_is_named_alone"
_LATE_JOINER = f"{_PROBE}::test_separate_shared_memory_is_found_and_udp_fixes_it"

# In the order in which a person would ask: link, discovery, processes, the rest. Checks run in the order of their modules.
# fmt: off
FINDINGS: tuple[FindingRow, ...] = (
    FindingRow("no-carrier", "link", "link.carrier", "the robot does not answer over the cable", _UNREACHABLE),
    FindingRow("wifi-roamed", "link", "link.roam",
        "the robot stops driving, its controllers seem dead; ssh says: No route to host",
        f"{_NETWORK_CAPTURES}::test_roamed_wifi_explains_unreachable_robot",
        note="NetworkManager does not run in the simulated laptop; `wifi-roam` causes the lost route for real"),
    FindingRow("wifi-may-roam", "link", "link.roam-risk",
        "the link dies in the middle of a session, although nobody touched anything",
        f"{_NETWORK_CAPTURES}::test_equal_wifi_priorities_warn_only_over_radio", severity=Severity.WARNING, playbook="pin-wifi",
        safe=True, note="no NetworkManager"),
    FindingRow("robot-unreachable", "link", "link.reachable",
        "the robot does not answer: no topics, blank panels, dead controllers", _UNREACHABLE,
        note="no route, timeout, refused, silence, another host key"),
    FindingRow("discovery-server-missing", "discovery", "discovery.server", _NO_GRAPH,
        f"{_LINK}::test_missing_discovery_server_is_the_only_root_cause", playbook="recover-discovery", safe=True,
        needs_vendor=True),
    FindingRow("discovery-server-switched-off", "discovery", "discovery.server", _NO_GRAPH,
        f"{_LINK}::test_vendor_stack_on_multicast_is_the_only_root_cause"),
    FindingRow("discovery-port-taken", "discovery", "discovery.server", _NO_GRAPH, _BAD_SERVER),
    FindingRow("discovery-server-stopped", "discovery", "discovery.server", _NO_GRAPH, _BAD_SERVER),
    FindingRow("discovery-server-pinned", "discovery", "discovery.server",
        "the graph is visible on one network only: ros2 topic list returns 2 over the other", _BAD_SERVER),
    FindingRow("robot-multi-homed", "multihoming", "dds.multi-homed",
        "telemetry arrives, commands do not: the base does not drive, arm services and list_controllers time out",
        f"{_LINK}::test_announced_address_without_route_is_named", playbook="single-home"),
    FindingRow("process-older-than-interface", "multihoming", "dds.older-than-interface",
        "nodes are listed, but none of their data arrives over this link",
        f"{_LINK}::test_process_older_than_link_address_is_named"),
    FindingRow("process-multicast-only", "dds_environment", "dds.processes",
        "a process claims to be live but shows no telemetry; a new terminal sees everything",
        f"{_SETUP}::test_node_from_unconfigured_shell_is_the_only_root_cause"),
    FindingRow("process-wrong-server", "dds_environment", "dds.wrong-server",
        "a process runs but receives nothing from the robot", f"{_SETUP}::test_node_with_wrong_server_is_the_only_root_cause"),
    FindingRow("rmw-mismatch", "dds_environment", "dds.middleware", "a process and the other nodes do not hear each other",
        f"{_NETWORK_CAPTURES}::test_process_on_another_middleware_is_named",
        note="only Fast DDS is installed in the test environment"),
    FindingRow("dds-not-set-up", "dds_environment", "dds.shell", "ros2 topic list returns 2 in every terminal of the laptop",
        _BAD_SHELL, severity=Severity.WARNING),
    FindingRow("source-order", "dds_environment", "dds.shell",
        "every new terminal lists 2 topics, although its startup file sources ros-env.sh",
        f"{_SETUP}::test_wrong_source_order_is_the_only_root_cause"),
    FindingRow("shell-multicast-only", "dds_environment", "dds.shell",
        "ros2 topic list returns 2 in this terminal: /parameter_events and /rosout", _BAD_SHELL, severity=Severity.WARNING),
    FindingRow("shell-rmw-mismatch", "dds_environment", "dds.shell",
        "programs started in this terminal and the robot do not hear each other", _BAD_SHELL, severity=Severity.WARNING),
    FindingRow("stale-daemon", "dds_environment", "dds.daemon",
        "ros2 topic list shows another graph than ros2 topic echo in the same terminal",
        f"{_SETUP}::test_stale_ros2_daemon_is_the_only_root_cause", severity=Severity.WARNING,
        note="a node under the daemon's arguments: the wheels bring no ros2 command"),
    FindingRow("profile-unreadable", "profiles", "dds.profiles", _PROFILE, _NO_SERVER),
    FindingRow("profile-not-default", "profiles", "dds.profiles", _PROFILE, _BAD_PROFILE),
    FindingRow("profile-not-super-client", "profiles", "dds.profiles", _PROFILE, _BAD_PROFILE),
    FindingRow("profile-wrong-prefix", "profiles", "dds.profiles", _PROFILE, _BAD_PROFILE),
    FindingRow("profile-without-server", "profiles", "dds.profiles", _PROFILE, _NO_SERVER),
    FindingRow("profile-wrong-address", "profiles", "dds.profiles", _PROFILE, _BAD_PROFILE),
    FindingRow("zombie-process", "stale_resources", "dds.zombies",
        "a new node sees the topics and gets no sample, or gets two answers",
        f"{_LINK}::test_stopped_process_on_dds_ports_is_the_only_root_cause", playbook="sweep", safe=True),
    FindingRow("shared-memory-not-shared", "stale_resources", "dds.shared-memory",
        "a late subscriber sees every topic name and gets no sample",
        f"{_LINK}::test_root_node_without_shared_memory_is_the_only_root_cause"),
    FindingRow("shared-memory-at-risk", "stale_resources", "dds.memory-at-risk",
        "the robot works until somebody logs in and out; after that, late joiners see names and get no samples", _LOGIND,
        severity=Severity.WARNING, playbook="keep-shared-memory", safe=True),
    FindingRow("shared-memory-removed", "stale_resources", "dds.removed-memory",
        "nodes that join now see every name and get no sample; nodes that joined before hear each other", _LOGIND,
        playbook="keep-shared-memory"),
    FindingRow("shared-memory-orphans", "stale_resources", "dds.orphans", "a new node starts and never completes discovery",
        f"{_LINK}::test_memory_of_killed_participant_is_the_only_root_cause", severity=Severity.WARNING, playbook="sweep",
        safe=True),
    FindingRow("port-8090-taken", "ports", "ports", "the operator's page does not start: Address already in use", _PORT),
    FindingRow("port-9090-taken", "ports", "ports", "the page cannot reach the graph (rosbridge): Address already in use",
        _PORT),
    FindingRow("port-123-taken", "ports", "ports", "the NTP server for the robot does not start: Address already in use",
        _PORT),
    FindingRow("port-8091-taken", "ports", "ports", "the robot's cameras deliver no pictures: Address already in use",
        f"{_CAMERAS}::test_program_on_the_port_of_the_pictures_is_named"),
    FindingRow("python-missing", "software", "software.release", "no part of Lupin can run on the robot", _PREREQUISITE),
    FindingRow("not-deployed", "software", "software.release", "without the laptop there is no drive bus, e-stop or home pose",
        _RELEASE, severity=Severity.WARNING, playbook="deploy-robot"),
    FindingRow("release-broken", "software", "software.release", "Lupin's units fail at start", _RELEASE,
        playbook="deploy-robot"),
    FindingRow("python-changed", "software", "software.release", "Lupin's units fail at start with ModuleNotFoundError",
        _RELEASE, playbook="deploy-robot"),
    FindingRow("version-skew", "software", "software.release", "services and topics of robot and laptop may not match",
        _RELEASE, severity=Severity.WARNING, playbook="deploy-robot"),
    FindingRow("groups-missing", "software", "software.groups", "'Permission denied' on cameras, motor board or gamepad",
        _PREREQUISITE, severity=Severity.WARNING),
    FindingRow("home-not-writable", "software", "software.home", "the vendor's environment script and every ROS log fail",
        _PREREQUISITE),
    FindingRow("vendor-service-down", "services", "units.vendor",
        "no controllers, no lidar, no battery state, no discovery server",
        f"{_HEALTH}::test_stopped_vendor_service_explains_its_consequences", playbook="heal"),
    FindingRow("unit-missing", "services", "units.lupin", "parts of Lupin do not start with the robot",
        f"{_HEALTH}::test_unit_missing_after_deploy_is_named", playbook="deploy-robot"),
    FindingRow("oneshot-failed", "services", "units.lupin", "controllers are stuck and the arm is not at its home pose",
        f"{_HEALTH}::test_failed_oneshot_shows_its_journal_lines", playbook="heal",
        note="`heal` for auto-home; a person for clock-sync", needs_vendor=True),
    FindingRow("unit-start-limit", "services", "units.lupin", "a part of Lupin is down, and systemd does not start it again",
        _STOPPED_UNIT, playbook="start-onboard", safe=True, note="the onboard unit; a person starts the others"),
    FindingRow("unit-failed", "services", "units.lupin", "a part of Lupin is down", _FAILED_UNIT, playbook="start-onboard",
        safe=True, note="the onboard unit; a person starts the others", needs_vendor=True),
    FindingRow("unit-restarting", "services", "units.lupin", "a part of Lupin goes down again and again", _FAILED_UNIT,
        needs_vendor=True),
    FindingRow("unit-not-running", "services", "units.lupin", "a part of Lupin is down", _STOPPED_UNIT,
        playbook="start-onboard", safe=True, note="the onboard unit; a person starts the others", needs_vendor=True),
    FindingRow("unit-not-enabled", "services", "units.lupin", "a part of Lupin does not start at the next boot",
        f"{_HEALTH}::test_disabled_unit_and_unread_unit_file_are_named", severity=Severity.WARNING),
    FindingRow("unit-outlived-vendor", "services", "units.together",
        "after a restart of the robot's stack, commands have no effect while everything looks alive",
        f"{_HEALTH}::test_unit_not_restarted_with_vendor_is_named", playbook="deploy-robot",
        note="a person restarts a unit that has its PartOf"),
    FindingRow("units-need-reload", "services", "units.reload", "a change to a unit file has no effect",
        f"{_HEALTH}::test_disabled_unit_and_unread_unit_file_are_named", severity=Severity.WARNING),
    FindingRow("clock-drift", "clocks", "clock.drift",
        "the map stops (Message Filter dropping message); transforms are too old or from the future",
        f"{_HEALTH}::test_clock_offset_is_named_with_its_uncertainty", playbook="sync-clock",
        note="without asking while the vendor's stack is down"),
    FindingRow("chrony-stock-makestep", "clocks", "clock.makestep",
        "controllers die without an error minutes after boot, as soon as a time source is reachable",
        f"{_HEALTH}::test_stock_makestep_is_named", severity=Severity.WARNING, playbook="install-clock-sync", safe=True),
    FindingRow("chrony-missing", "clocks", "clock.robot",
        "after every boot the clock is as wrong as it was at the last shutdown", _TIME_SOURCE),
    FindingRow("chrony-not-running", "clocks", "clock.robot",
        "the clock drifts by seconds a day, and by hours over a power-off: there is no hardware clock",
        f"{_HEALTH}::test_stopped_chrony_is_named", severity=Severity.WARNING,
        note="asks, then plays `install-clock-sync` if chrony may step the clock"),
    FindingRow("chrony-sources-silent", "clocks", "clock.robot", "the robot's clock follows no time source", _TIME_SOURCE,
        severity=Severity.WARNING, playbook="serve-clock"),
    FindingRow("chrony-not-serving", "clocks", "clock.laptop",
        "the robot's clock stays wrong after a boot, although its clock-sync unit is installed",
        f"{_HEALTH}::test_laptop_not_serving_time_is_named", severity=Severity.WARNING, playbook="serve-clock"),
    FindingRow("type-mismatch", "topic_delivery", "graph.qos", "a subscriber never gets a message, without any error", _ZEROS),
    FindingRow("qos-mismatch", "topic_delivery", "graph.qos", "a subscriber never gets a message, without any error",
        _GRAPH_FAULTS),
    FindingRow("names-no-samples", "topic_delivery", "graph.samples",
        "every topic is listed and no sample arrives, though the robot's own nodes work", _LATE_JOINER, over_graph=True),
    FindingRow("one-way-data", "topic_delivery", "graph.asymmetry",
        "telemetry is live, and no drive command, arm service or controller call gets through",
        f"{_GRAPH}::test_dual_homed_robot_shows_one_way_data", playbook="single-home", over_graph=True),
    FindingRow("topic-silent", "topic_delivery", "graph.silent", "everything that needs the topic waits for it", _SILENT,
        over_graph=True, needs_vendor=True),
    FindingRow("camera-silent", "topic_delivery", "graph.cameras", "a camera's picture is black or frozen", _SILENT,
        over_graph=True, needs_vendor=True),
    FindingRow("graph-not-visited", "topic_delivery", "graph.visit",
        "no program of the laptop can join the graph, or the doctor cannot",
        f"{_GRAPH_CAPTURES}::test_failed_graph_visit_is_named", severity=Severity.WARNING, over_graph=True),
    FindingRow("controllers-not-active", "controllers", "controllers.states",
        "the base does not drive, or arm and gripper do not move, without any error",
        f"{_GRAPH}::test_unconfigured_controllers_explain_silent_topics", playbook="heal", over_graph=True, needs_vendor=True),
    FindingRow("controller-manager-missing", "controllers", "controllers.manager",
        "wheels, arm and gripper are dead; the lidar may still work", _REAL_NODES, playbook="sync-clock",
        over_graph=True, needs_vendor=True),
    FindingRow("controller-manager-silent", "controllers", "controllers.manager",
        "wheels, arm and gripper are dead although every topic is listed",
        f"{_GRAPH_CAPTURES}::test_hanging_controller_manager_differs_from_one_way_link", playbook="sync-clock",
        note="the simulated one shares its process with the rest", over_graph=True, needs_vendor=True),
    FindingRow("drive-sink-unheard", "drive", "drive.sink", "the robot ignores every drive command, without any error",
        _GRAPH_FAULTS, over_graph=True, needs_vendor=True),
    FindingRow("estop-engaged", "drive", "drive.estop", _NOT_DRIVING, _REAL_NODES),
    FindingRow("bus-locked", "drive", "drive.estop", _NOT_DRIVING,
        f"{_GRAPH_CAPTURES}::test_engaged_stop_names_its_holder_and_explains_bus_lock"),
    FindingRow("drive-bypassed", "drive", "drive.publishers",
        "the robot moves without a command, or the e-stop does not stop it", _REAL_NODES),
    FindingRow("estop-forged", "drive", "drive.publishers", "the e-stop is released, and the robot does not drive",
        _REAL_NODES),
    FindingRow("page-holds-bus", "drive", "drive.inputs",
        "navigation has a goal and the robot stands still: an open page holds the drive bus", _GRAPH_FAULTS,
        severity=Severity.WARNING),
    FindingRow("pad-holds-bus", "drive", "drive.inputs",
        "navigation has a goal and the robot stands still: the gamepad holds the drive bus", _ZEROS, severity=Severity.WARNING),
    FindingRow("board-wedged", "motor_board", "board.motor",
        "wheels spin freely and ignore commands; battery, IMU and red button publish nothing", _SILENT,
        note="captured: what USB and kernel print", needs_vendor=True),
    FindingRow("battery-unreadable", "motor_board", "board.battery", "a mission does not end when the battery runs low",
        _REAL_NODES, severity=Severity.WARNING),
    FindingRow("battery-low", "motor_board", "board.battery",
        "missions return to the dock; servos and single-board computer brown out", _GRAPH_FAULTS),
    FindingRow("camera-held", "cameras", "cameras",
        "black or missing camera images; 'Device or resource busy' in the system journal",
        f"{_HEALTH}::test_stray_camera_holder_is_named_with_its_pid", note="the device is a file"),
    FindingRow("camera-absent", "cameras", "cameras.drivers", "no images from a camera", _CAMERA_FAULTS),
    FindingRow("camera-driver-missing", "cameras", "cameras.drivers", "no images from a camera", _CAMERA_FAULTS),
    FindingRow("camera-driver-failing", "cameras", "cameras.drivers", "no images from a camera, or interrupted ones",
        _CAMERA_FAULTS),
    FindingRow("filesystem-read-only", "resources", "machine.storage", "logs stop, settings are lost, a deploy fails", _DISK),
    FindingRow("shared-memory-full", "resources", "machine.storage", "new nodes see names and get no samples, or die at start",
        f"{_HEALTH}::test_full_shared_memory_is_named", playbook="sweep"),
    FindingRow("disk-full", "resources", "machine.storage", "logs stop, a deploy fails, services that write die at start",
        _DISK),
    FindingRow("inodes-used-up", "resources", "machine.storage", "'No space left on device' although there is space",
        f"{_HEALTH}::test_used_up_inodes_are_named"),
    FindingRow("memory-low", "resources", "machine.memory", "everything stutters; soon the kernel kills a process",
        _CAPTURED_CASE, note="the memory is the host's own"),
    FindingRow("killed-for-memory", "resources", "machine.memory", "a process vanished without an error", _CAPTURED_CASE,
        severity=Severity.WARNING, note="the memory is the host's own"),
    FindingRow("under-voltage", "resources", "machine.heat", "USB devices drop out, the board resets, the card loses data",
        _CAPTURED_CASE, note="a container has no sensors"),
    FindingRow("too-hot", "resources", "machine.heat", "nodes miss their rates, images and scans come late", _CAPTURED_CASE,
        note="a container has no sensors"),
)
# fmt: on
_BY_ID: Mapping[str, FindingRow] = {row.id: row for row in FINDINGS}
OVER_GRAPH = frozenset(row.id for row in FINDINGS if row.over_graph)
NEED_VENDOR = frozenset(row.id for row in FINDINGS if row.needs_vendor)


def modules() -> tuple[str, ...]:
    """Return the modules with Lupin's own checks, in the order in which the checks run."""
    return tuple(f"lupin_cli.checks.{name}" for name in dict.fromkeys(row.module for row in FINDINGS))


def make_finding(
    id: str,
    *,
    where: str,
    cause: str,
    evidence: Iterable[str],
    command: str,
    playbook: str | None = None,
    variables: Mapping[str, Any] | None = None,
    safe: bool | None = None,
    severity: Severity | None = None,
    symptom: str = "",
    explains: Iterable[str] = (),
    about: str = "",
    blocks_playbooks: Iterable[str] = (),
) -> Finding:
    """Build the finding `id`. Severity, symptom, playbook and safety come from its row unless they are passed.

    `command` is what a person types. Pass `playbook=""` if only a person can fix this case. Raises KeyError for an id without
    a row.
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
        fix=Fix(command, chosen_playbook, dict(variables or {}), safe=is_safe and bool(chosen_playbook)),
        explains=frozenset(explains),
        about=about,
        blocks_playbooks=frozenset(blocks_playbooks),
    )
