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

# Tests that cause the fault on a booted robot or on a graph of real nodes.
_LINK = "tests/lupin_cli/doctor/test_doctor_on_host.py"
_SETUP = "tests/lupin_cli/doctor/test_setup_on_host.py"
_HEALTH = "tests/lupin_cli/checks/test_checks_on_host.py"
_PATH = "tests/lupin_cli/doctor/test_path_on_host.py"
_PACKETS = "tests/lupin_cli/link/test_path.py"
_CAMERAS = "tests/lupin_cli/systemd/test_cameras_on_host.py"
_GRAPH = "tests/lupin_cli/checks/test_graph_checks_on_host.py"
_PROBE = "tests/lupin_runtime/stack/test_graph_probe.py"
# Tests that judge output captured from a machine.
_NETWORK_CAPTURES = "tests/lupin_cli/checks/test_network_checks.py"
_LINK_CAPTURES = "tests/lupin_cli/checks/test_link_checks.py"
_HEALTH_CAPTURES = "tests/lupin_cli/checks/test_health_checks.py"
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
    note: str = ""  # for the manual: what the proof covers, or why it judges captured output
    fix_note: str = ""  # for the manual: in which cases `--fix` does something else
    over_dds: bool = False  # it is observed over DDS: a broken link or discovery explains it
    in_vendor_unit: bool = False  # it concerns what the vendor's service runs: that the service is down explains it
    layer: str = ""  # where on the path the fault is; empty: that of most findings of its module
    breaks: tuple[str, ...] = ()  # the parts of `checks.layers` whose data does not arrive any more

    @property
    def path_layer(self) -> str:
        """The layer to which the finding belongs."""
        return self.layer or _LAYERS_OF_MODULES[self.module]

    @property
    def captured(self) -> bool:
        """Whether the proof judges captured output instead of causing the fault."""
        return self.proof.partition("::")[0] in (_NETWORK_CAPTURES, _LINK_CAPTURES, _HEALTH_CAPTURES, _CASES, _GRAPH_CAPTURES)


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
    "services": "processes",
    "clocks": "clock",
    "topic_delivery": "samples",
    "controllers": "processes",
    "drive": "samples",
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
_SMALL_BUFFERS = f"{_HEALTH_CAPTURES}::test_full_socket_buffers_are_named_if_the_kernel_limits_them"
_DAMAGED_RELEASE = "tests/lupin_cli/release/test_signing_on_host.py::test_changed_byte_is_named_refused_and_repaired"
_CAPTURED_CASE = f"{_CASES}::test_captured_fault_is_named_alone"
_SILENT = f"{_GRAPH}::test_silent_sensor_and_silent_board_are_distinguished"
_GRAPH_FAULTS = f"{_GRAPH}::test_simultaneous_graph_faults_are_each_named"
_ZEROS = f"{_GRAPH}::test_gamepad_zeros_and_type_mismatch_are_named"
_REAL_NODES = f"{_PROBE}::test_faults_of_real_nodes_give_exactly_their_findings"
_CAMERA_FAULTS = f"{_CAMERAS}::test_each_fault_of_a_camera_is_named_alone"
_LATE_JOINER = f"{_PROBE}::test_separate_shared_memory_is_found_and_udp_fixes_it"
_IF_CLOCK_WRONG = "only while the clock is wrong, or was not measured; otherwise restart the vendor's unit by hand"
_HOST_MEMORY = "the simulated computer uses the memory of this machine and has no limit of its own"
_NO_SENSORS = "the simulated computer has no temperature or voltage sensors"

# In the order in which a person would look for the cause: link, discovery, processes, the rest. Checks run in the order of
# their modules.
# fmt: off
FINDINGS: tuple[FindingRow, ...] = (
    FindingRow("unexplained", "ground_truth", "ground-truth", "this machine lacks data of the robot",
        f"{_PATH}::test_loss_that_no_check_explains_is_a_finding",
        over_dds=True, in_vendor_unit=True),
    FindingRow("part-missing", "missing_parts", "processes.missing", "a part of the robot is not in the graph",
        f"{_GRAPH_CAPTURES}::test_part_without_publishers_is_named_with_its_unit",
        note="the simulated robot is one process, of which no part can be missing", over_dds=True, in_vendor_unit=True),
    FindingRow("no-carrier", "link", "link.carrier", "the robot does not answer over the cable", _UNREACHABLE, breaks=_ALL),
    FindingRow("wifi-roamed", "wifi", "link.roam",
        "the robot stops driving, its controllers seem dead; ssh says: No route to host",
        f"{_NETWORK_CAPTURES}::test_roamed_wifi_explains_unreachable_robot",
        note="the simulated laptop runs no NetworkManager; the simulator's fault `wifi-roam` only removes its route",
        layer="route", breaks=_ALL),
    FindingRow("wifi-may-roam", "wifi", "link.roam-risk",
        "the link drops during operation, although nobody touched anything",
        f"{_NETWORK_CAPTURES}::test_equal_wifi_priorities_warn_only_over_radio", severity=Severity.WARNING, playbook="pin-wifi",
        safe=True, note="the simulated laptop runs no NetworkManager", layer="route"),
    FindingRow("network-conflict", "own_networks", "link.own-networks",
        "the robot does not answer, or another machine seems to be at its address",
        f"{_LINK_CAPTURES}::test_own_address_of_the_laptop_is_no_robot",
        note="the simulated laptop has the addresses that the simulated robot gives it", layer="address", breaks=_ALL),
    FindingRow("address-missing", "path", "path.packets", "no packet reaches the other machine",
        f"{_PACKETS}::test_lost_address_is_named_on_its_machine", layer="address", breaks=_ALL),
    FindingRow("route-elsewhere", "path", "path.packets", "packets leave on another network than that of the other machine",
        f"{_PACKETS}::test_route_over_another_interface_is_named", layer="route", breaks=_ALL),
    FindingRow("no-route", "path", "path.packets", "no packet reaches the other machine",
        f"{_PACKETS}::test_missing_route_is_named_on_its_machine", layer="route", breaks=_ALL),
    FindingRow("neighbor-wrong", "path", "path.packets", "no packet reaches the other machine",
        f"{_PACKETS}::test_permanent_neighbor_entry_is_named", layer="address", breaks=_ALL),
    FindingRow("link-dead", "path", "path.packets", "nothing passes, although both ends have a carrier",
        f"{_PACKETS}::test_dead_switch_lies_between_the_interfaces", layer="carrier", breaks=_ALL),
    FindingRow("large-packets-lost", "path", "path.packets", "names appear, and large messages never arrive",
        f"{_PACKETS}::test_small_mtu_is_named_on_its_machine", layer="mtu", breaks=_ALL),
    FindingRow("packets-lost", "path", "path.packets", "topics stutter, services answer late or never",
        f"{_PACKETS}::test_random_loss_is_no_firewall", layer="loss", breaks=_ALL),
    FindingRow("udp-lost", "path", "path.packets", "ROS data of one direction or of some ports never arrives",
        f"{_PACKETS}::test_blocked_ports_are_named_with_direction_and_machine", breaks=_ALL),
    FindingRow("socket-not-read", "path", "path.sockets", "a program is listed and does nothing",
        f"{_PACKETS}::test_program_that_does_not_read_its_socket_is_named", layer="processes", over_dds=True,
        breaks=_ALL),
    FindingRow("robot-unreachable", "link", "link.reachable",
        "the robot does not answer: no topics, blank panels, dead controllers", _UNREACHABLE,
        note="covers: no route, timeout, connection refused, no answer, changed host key"),
    FindingRow("discovery-server-missing", "discovery", "discovery.server", _NO_GRAPH,
        f"{_LINK}::test_missing_discovery_server_is_the_only_root_cause", playbook="recover-discovery", safe=True,
        in_vendor_unit=True, breaks=_ALL),
    FindingRow("discovery-server-switched-off", "discovery", "discovery.server", _NO_GRAPH,
        f"{_LINK}::test_vendor_stack_on_multicast_is_the_only_root_cause", breaks=_ALL),
    FindingRow("discovery-port-taken", "discovery", "discovery.server", _NO_GRAPH, _BAD_SERVER, breaks=_ALL),
    FindingRow("discovery-server-stopped", "discovery", "discovery.server", _NO_GRAPH, _BAD_SERVER, breaks=_ALL),
    FindingRow("discovery-server-pinned", "discovery", "discovery.server",
        "the graph is visible on one network only; over the other, ros2 topic list shows only /parameter_events and /rosout",
        _BAD_SERVER, breaks=_ALL),
    FindingRow("discovery-server-other-id", "discovery", "discovery.server", _NO_GRAPH,
        f"{_NETWORK_CAPTURES}::test_server_with_another_id_is_named", note="the command line is judged from captured output",
        breaks=_ALL),
    FindingRow("robot-multi-homed", "multihoming", "dds.multi-homed",
        "telemetry arrives, commands do not: the base does not drive, arm services and list_controllers time out",
        f"{_LINK}::test_announced_address_without_route_is_named", playbook="single-home", breaks=_ALL),
    FindingRow("process-older-than-interface", "multihoming", "dds.older-than-interface",
        "nodes are listed, but none of their data arrives over this link",
        f"{_LINK}::test_process_older_than_link_address_is_named", breaks=_ALL),
    FindingRow("process-multicast-only", "dds_environment", "dds.processes",
        "a process runs but receives no telemetry; a program started in a new terminal receives it",
        f"{_SETUP}::test_node_from_unconfigured_shell_is_the_only_root_cause"),
    FindingRow("process-wrong-server", "dds_environment", "dds.wrong-server",
        "a process runs but receives nothing from the robot", f"{_SETUP}::test_node_with_wrong_server_is_the_only_root_cause"),
    FindingRow("rmw-mismatch", "dds_environment", "dds.middleware",
        "a process and the other nodes do not receive each other's data",
        f"{_NETWORK_CAPTURES}::test_process_on_another_middleware_is_named",
        note="only Fast DDS is installed in the test environment"),
    FindingRow("dds-not-set-up", "shell_environment", "dds.shell",
        "ros2 topic list shows only /parameter_events and /rosout in every terminal of the laptop",
        _BAD_SHELL, severity=Severity.WARNING, breaks=_ALL),
    FindingRow("source-order", "shell_environment", "dds.shell",
        "ros2 topic list shows only /parameter_events and /rosout, although the terminal's startup file sources ros-env.sh",
        f"{_SETUP}::test_wrong_source_order_is_the_only_root_cause", breaks=_ALL),
    FindingRow("shell-multicast-only", "shell_environment", "dds.shell",
        "ros2 topic list shows only /parameter_events and /rosout in this terminal", _BAD_SHELL, severity=Severity.WARNING,
        breaks=_ALL),
    FindingRow("shell-without-profile", "shell_environment", "dds.shell",
        "ros2 topic list shows only /parameter_events and /rosout in this terminal",
        f"{_NETWORK_CAPTURES}::test_shell_without_the_profile_is_named", note="the variables are judged from captured output",
        severity=Severity.WARNING, breaks=_ALL),
    FindingRow("shell-rmw-mismatch", "shell_environment", "dds.shell",
        "programs started in this terminal and the robot do not receive each other's data", _BAD_SHELL,
        severity=Severity.WARNING, breaks=_ALL),
    FindingRow("shell-other-graph", "shell_environment", "dds.shell",
        "programs started in this terminal hear nothing of the robot",
        f"{_NETWORK_CAPTURES}::test_shell_variables_that_lead_elsewhere_are_named",
        note="the variables are judged from captured output", breaks=_ALL),
    FindingRow("shell-wrong-server", "shell_environment", "dds.shell-server",
        "programs started in this terminal hear nothing of the robot", f"{_PATH}::test_wrong_port_is_named", breaks=_ALL),
    FindingRow("shell-program-fails", "shell_environment", "dds.shell-program",
        "every ROS program that is started in this terminal exits at once",
        f"{_NETWORK_CAPTURES}::test_program_that_fails_in_this_shell_is_named", note="the error is judged from captured output",
        breaks=_ALL),
    FindingRow("stale-daemon", "shell_environment", "dds.daemon",
        "ros2 topic list shows another graph than ros2 topic echo in the same terminal",
        f"{_SETUP}::test_stale_ros2_daemon_is_the_only_root_cause", severity=Severity.WARNING,
        note="the test starts a node with the daemon's command line, because the ROS wheels contain no ros2 command"),
    FindingRow("profile-unreadable", "profiles", "dds.profiles", _PROFILE, _NO_SERVER),
    FindingRow("profile-not-default", "profiles", "dds.profiles", _PROFILE, _BAD_PROFILE),
    FindingRow("profile-not-super-client", "profiles", "dds.profiles", _PROFILE, _BAD_PROFILE),
    FindingRow("profile-wrong-prefix", "profiles", "dds.profiles", _PROFILE, _BAD_PROFILE),
    FindingRow("profile-without-server", "profiles", "dds.profiles", _PROFILE, _NO_SERVER),
    FindingRow("profile-excludes-link", "profiles", "dds.profiles", _PROFILE,
        f"{_NETWORK_CAPTURES}::test_profile_that_excludes_the_link_is_named", note="the files are judged from captured output"),
    FindingRow("profile-wrong-address", "profiles", "dds.profiles", _PROFILE, _BAD_PROFILE),
    FindingRow("profile-changed", "profiles", "dds.profile-age",
        "the profile is right, and a process behaves as if it were not",
        f"{_NETWORK_CAPTURES}::test_process_older_than_its_profile_is_named", severity=Severity.WARNING,
        note="the ages are judged from captured output"),
    FindingRow("process-stopped", "stale_resources", "processes.stopped",
        "topics are listed and silent, services do not answer, while every unit is active",
        f"{_PATH}::test_stopped_process_of_a_service_is_the_only_root", playbook="resume-process", layer="processes",
        note="without asking if it is the e-stop", breaks=_ALL),
    FindingRow("zombie-process", "stale_resources", "dds.zombies",
        "a new node sees the topics but gets no sample, or a service call gets two responses",
        f"{_LINK}::test_stopped_process_on_dds_ports_is_the_only_root_cause", playbook="sweep", safe=True,
        layer="processes"),
    FindingRow("shared-memory-not-shared", "stale_resources", "dds.shared-memory",
        "a late subscriber sees every topic name but gets no sample",
        f"{_LINK}::test_node_of_root_that_shares_no_memory_is_found"),
    FindingRow("shared-memory-at-risk", "stale_resources", "dds.memory-at-risk",
        "the robot works until somebody logs in and out; after that, late joiners see names and get no samples", _LOGIND,
        severity=Severity.WARNING, playbook="keep-shared-memory", safe=True),
    FindingRow("shared-memory-removed", "stale_resources", "dds.removed-memory",
        "nodes that join now see every name but get no sample; nodes that joined before receive each other's data", _LOGIND,
        playbook="keep-shared-memory"),
    FindingRow("shared-memory-orphans", "stale_resources", "dds.orphans", "a new node starts and never completes discovery",
        f"{_LINK}::test_memory_of_killed_participant_is_the_only_root_cause", severity=Severity.WARNING, playbook="sweep",
        safe=True),
    FindingRow("port-8090-taken", "ports", "ports", "the operator's page does not start: Address already in use", _PORT),
    FindingRow("port-9090-taken", "ports", "ports", "the page cannot reach the graph (rosbridge): Address already in use",
        _PORT),
    FindingRow("port-123-taken", "ports", "ports", "the NTP server for the robot does not start: Address already in use",
        _PORT),
    FindingRow("port-8091-taken", "ports", "ports", "the robot's cameras deliver no images: Address already in use",
        f"{_CAMERAS}::test_program_on_camera_port_is_named"),
    FindingRow("python-missing", "software", "software.release", "no part of Lupin can run on the robot", _PREREQUISITE,
        breaks=(LUPIN, DRIVE)),
    FindingRow("not-deployed", "software", "software.release", "without the laptop there is no drive bus, e-stop or home pose",
        _RELEASE, severity=Severity.WARNING, playbook="deploy-robot", layer="release"),
    FindingRow("release-broken", "software", "software.release", "Lupin's units fail at start", _RELEASE,
        playbook="deploy-robot", breaks=(LUPIN, DRIVE)),
    FindingRow("python-changed", "software", "software.release", "Lupin's units fail at start with ModuleNotFoundError",
        _RELEASE, playbook="deploy-robot", breaks=(LUPIN, DRIVE)),
    FindingRow("version-skew", "software", "software.release", "services and topics of robot and laptop may not match",
        _RELEASE, severity=Severity.WARNING, playbook="deploy-robot"),
    FindingRow("release-damaged", "software", "software.release-files",
        "Lupin's units refuse to start, or a part of Lupin crashes at a late import", _DAMAGED_RELEASE,
        playbook="deploy-robot", breaks=(LUPIN, DRIVE)),
    FindingRow("release-unsigned", "software", "software.release-files", "nothing shows whether the release is undamaged",
        _CAPTURED_CASE, severity=Severity.WARNING, playbook="deploy-robot"),
    FindingRow("groups-missing", "software", "software.groups", "'Permission denied' on cameras, motor board or gamepad",
        _PREREQUISITE, severity=Severity.WARNING, layer="login"),
    FindingRow("home-not-writable", "software", "software.home", "the vendor's environment script and every ROS log fail",
        _PREREQUISITE, layer="login"),
    FindingRow("unit-environment", "services", "units.environment",
        "a unit of the robot is down, or what it runs is heard by nobody",
        f"{_NETWORK_CAPTURES}::test_unit_environment_that_leads_elsewhere_is_named",
        note="only Fast DDS is installed in the test environment", layer="environment", breaks=_ALL),
    FindingRow("process-environment", "services", "units.processes",
        "nodes of the robot run, and nobody on the laptop hears them",
        f"{_NETWORK_CAPTURES}::test_environment_of_robot_processes_is_judged", layer="environment",
        note="the variables are judged from captured output", breaks=_ALL),
    FindingRow("unit-frozen", "services", "units.frozen", "topics are listed and silent, while every unit is active",
        f"{_HEALTH_CAPTURES}::test_frozen_and_restricted_units_are_parsed_and_named",
        note="the simulated computer's kernel freezes no control group", breaks=_ALL),
    FindingRow("unit-without-network", "services", "units.network",
        "a unit of the robot runs, and nobody on the laptop hears it",
        f"{_HEALTH_CAPTURES}::test_frozen_and_restricted_units_are_parsed_and_named",
        note="the simulated computer's kernel filters no control group", breaks=_ALL),
    FindingRow("vendor-service-down", "services", "units.vendor",
        "no controllers, no lidar, no battery state, no discovery server",
        f"{_HEALTH}::test_stopped_vendor_service_explains_its_consequences", playbook="heal", breaks=_ALL),
    FindingRow("unit-missing", "services", "units.lupin", "parts of Lupin do not start with the robot",
        f"{_HEALTH}::test_unit_missing_after_deploy_is_named", playbook="deploy-robot"),
    FindingRow("oneshot-failed", "services", "units.lupin", "controllers are stuck and the arm is not at its home pose",
        f"{_HEALTH}::test_failed_oneshot_shows_its_journal_lines", playbook="heal",
        fix_note="only for lupin-auto-home; lupin-clock-sync by hand", in_vendor_unit=True),
    FindingRow("unit-start-limit", "services", "units.lupin", "a part of Lupin is down, and systemd does not start it again",
        _STOPPED_UNIT, playbook="start-onboard", safe=True, fix_note="only for lupin-onboard; other units by hand"),
    FindingRow("unit-failed", "services", "units.lupin", "a part of Lupin is down", _FAILED_UNIT, playbook="start-onboard",
        safe=True, fix_note="only for lupin-onboard; other units by hand", in_vendor_unit=True),
    FindingRow("unit-restarting", "services", "units.lupin", "a part of Lupin goes down again and again", _FAILED_UNIT,
        in_vendor_unit=True),
    FindingRow("unit-not-running", "services", "units.lupin", "a part of Lupin is down", _STOPPED_UNIT,
        playbook="start-onboard", safe=True, fix_note="only for lupin-onboard; other units by hand", in_vendor_unit=True),
    FindingRow("unit-starting", "services", "units.lupin", "a part of Lupin is down: systemd waits until it has started",
        f"{_HEALTH_CAPTURES}::test_unit_that_never_gets_ready_is_named", note="judged from captured output", over_dds=True,
        in_vendor_unit=True, breaks=(LUPIN, DRIVE)),
    FindingRow("unit-not-enabled", "services", "units.lupin", "a part of the robot does not start at the next boot",
        f"{_HEALTH}::test_disabled_unit_and_unread_unit_file_are_named", severity=Severity.WARNING),
    FindingRow("unit-outlived-vendor", "services", "units.together",
        "after a restart of the robot's stack, commands have no effect while everything looks alive",
        f"{_HEALTH}::test_unit_not_restarted_with_vendor_is_named", playbook="deploy-robot",
        fix_note="only if the unit's file lacks PartOf=mirte-ros.service; otherwise restart the unit by hand",
        breaks=(LUPIN, DRIVE)),
    FindingRow("run-interrupted", "runs", "runs.interrupted", "a machine is half way between two states",
        f"{_CASES}::test_captured_fault_is_named_alone", severity=Severity.WARNING),
    FindingRow("units-need-reload", "services", "units.reload", "a change to a unit file has no effect",
        f"{_HEALTH}::test_disabled_unit_and_unread_unit_file_are_named", severity=Severity.WARNING),
    FindingRow("clock-drift", "clocks", "clock.drift",
        "the map stops (Message Filter dropping message); transforms are too old or from the future",
        f"{_HEALTH}::test_clock_offset_is_named_with_its_uncertainty", playbook="sync-clock",
        fix_note="without asking while the stack is down; up to 3 s, chrony slews a running stack's clock; a person if either "
        "clock may be wrong",
        breaks=(STAMPS,)),
    FindingRow("chrony-stock-makestep", "clocks", "clock.makestep",
        "controllers die without an error minutes after boot, as soon as a time source is reachable",
        f"{_HEALTH}::test_stock_makestep_is_named", severity=Severity.WARNING, playbook="install-clock-sync", safe=True),
    FindingRow("chrony-missing", "clocks", "clock.robot",
        "after every boot the clock is as wrong as it was at the last shutdown", _TIME_SOURCE),
    FindingRow("chrony-not-running", "clocks", "clock.robot",
        "the clock drifts by seconds a day, and by hours over a power-off: there is no hardware clock",
        f"{_HEALTH}::test_stopped_chrony_is_named", severity=Severity.WARNING,
        fix_note="if chrony is allowed to step the clock, asks, then plays `install-clock-sync`"),
    FindingRow("other-time-daemon", "clocks", "clock.robot",
        "the clock is stepped while the stack runs, or is as wrong after a boot as it was at the last shutdown",
        f"{_HEALTH_CAPTURES}::test_other_time_daemon_is_named", severity=Severity.WARNING,
        note="the simulated robot has no other time daemon"),
    FindingRow("chrony-sources-silent", "clocks", "clock.robot", "the robot's clock follows no time source", _TIME_SOURCE,
        severity=Severity.WARNING, playbook="serve-clock"),
    FindingRow("chrony-not-serving", "clocks", "clock.laptop",
        "the robot's clock stays wrong after a boot, although its clock-sync unit is installed",
        f"{_HEALTH}::test_laptop_not_serving_time_is_named", severity=Severity.WARNING, playbook="serve-clock"),
    FindingRow("type-mismatch", "topic_delivery", "graph.qos", "a subscriber never gets a message, without any error", _ZEROS,
        layer="endpoints"),
    FindingRow("qos-mismatch", "topic_delivery", "graph.qos", "a subscriber never gets a message, without any error",
        _GRAPH_FAULTS, layer="endpoints"),
    FindingRow("frame-wrong", "topic_delivery", "graph.headers",
        "the map does not grow, or grows turned or shifted; transforms of the frame do not exist", _REAL_NODES,
        over_dds=True),
    FindingRow("stamps-wrong", "topic_delivery", "graph.headers",
        "the map stops (Message Filter dropping message); transforms are too old or from the future", _REAL_NODES,
        over_dds=True, breaks=(STAMPS,)),
    FindingRow("names-no-samples", "topic_delivery", "graph.samples",
        "every topic is listed but no sample arrives, though the robot's own nodes work", _LATE_JOINER, over_dds=True,
        breaks=_ALL),
    FindingRow("one-way-data", "topic_delivery", "graph.asymmetry",
        "telemetry arrives, but no drive command, arm service or controller call gets through",
        f"{_GRAPH}::test_multihomed_robot_shows_one_way_data", playbook="single-home", over_dds=True, breaks=_ALL),
    FindingRow("topic-silent", "topic_delivery", "graph.silent", "everything that needs the topic waits for it", _SILENT,
        over_dds=True, in_vendor_unit=True),
    FindingRow("camera-silent", "topic_delivery", "graph.cameras", "a camera's image is black or frozen", _SILENT,
        over_dds=True, in_vendor_unit=True),
    FindingRow("graph-not-visited", "topic_delivery", "graph.visit",
        "programs on the laptop, or only the doctor, cannot join the graph",
        f"{_GRAPH_CAPTURES}::test_failed_graph_probe_is_named", severity=Severity.WARNING, over_dds=True, breaks=_ALL),
    FindingRow("controllers-not-active", "controllers", "controllers.states",
        "the base does not drive, or arm and gripper do not move, without any error",
        f"{_GRAPH}::test_unconfigured_controllers_explain_silent_topics", playbook="heal", over_dds=True, in_vendor_unit=True,
        breaks=(BASE_PART, DRIVE)),
    FindingRow("controller-manager-missing", "controllers", "controllers.manager",
        "wheels, arm and gripper are dead; the lidar may still work", _REAL_NODES, playbook="sync-clock",
        over_dds=True, in_vendor_unit=True, breaks=(BASE_PART, DRIVE)),
    FindingRow("controller-manager-silent", "controllers", "controllers.manager",
        "wheels, arm and gripper are dead although every topic is listed",
        f"{_GRAPH_CAPTURES}::test_hanging_controller_manager_differs_from_one_way_link", playbook="sync-clock",
        note="the simulated controller manager shares a process with other nodes and cannot hang alone",
        over_dds=True, in_vendor_unit=True, breaks=(BASE_PART, DRIVE)),
    FindingRow("drive-sink-unheard", "drive", "drive.sink", "the robot ignores every drive command, without any error",
        _GRAPH_FAULTS, over_dds=True, in_vendor_unit=True, layer="endpoints", breaks=(DRIVE,)),
    FindingRow("estop-engaged", "drive", "drive.estop", _NOT_DRIVING, _REAL_NODES),
    FindingRow("bus-locked", "drive", "drive.locks", _NOT_DRIVING,
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
        note="the USB devices and the kernel's messages are judged from captured output", in_vendor_unit=True,
        breaks=(BOARD_PART,)),
    FindingRow("serial-port-closed", "motor_board", "board.serial",
        "wheels, battery, IMU and lidar are dead; 'Permission denied' in the system journal",
        f"{_GRAPH_CAPTURES}::test_serial_port_that_the_user_may_not_open_is_named",
        note="the simulated computer has no serial port", breaks=(BOARD_PART, LIDAR_PART)),
    FindingRow("battery-unreadable", "motor_board", "board.battery", "a mission does not end when the battery runs low",
        _REAL_NODES, severity=Severity.WARNING),
    FindingRow("battery-low", "motor_board", "board.battery",
        "missions return to the dock; servos and single-board computer brown out", _GRAPH_FAULTS),
    FindingRow("camera-held", "cameras", "cameras",
        "black or missing camera images; 'Device or resource busy' in the system journal",
        f"{_HEALTH}::test_stray_camera_holder_is_named_with_its_pid",
        note="the simulated computer has no camera: the test opens a regular file, /dev/video0"),
    FindingRow("camera-absent", "cameras", "cameras.drivers", "no images from a camera", _CAMERA_FAULTS),
    FindingRow("camera-driver-missing", "cameras", "cameras.drivers", "no images from a camera", _CAMERA_FAULTS),
    FindingRow("camera-driver-failing", "cameras", "cameras.drivers", "no images from a camera, or interrupted ones",
        _CAMERA_FAULTS),
    FindingRow("filesystem-read-only", "resources", "machine.storage", "logs stop, settings are lost, a deploy fails", _DISK),
    FindingRow("shared-memory-full", "resources", "machine.storage", "new nodes see names and get no samples, or die at start",
        f"{_HEALTH}::test_full_shared_memory_is_named", playbook="sweep", layer="machine"),
    FindingRow("disk-full", "resources", "machine.storage", "logs stop, a deploy fails, services that write die at start",
        _DISK),
    FindingRow("inodes-used-up", "resources", "machine.storage", "'No space left on device' although there is space",
        f"{_HEALTH}::test_used_up_inodes_are_named"),
    FindingRow("memory-low", "resources", "machine.memory", "everything stutters; soon the kernel kills a process",
        _CAPTURED_CASE, note=_HOST_MEMORY),
    FindingRow("killed-for-memory", "resources", "machine.memory", "a process vanished without an error", _CAPTURED_CASE,
        severity=Severity.WARNING, note=_HOST_MEMORY),
    FindingRow("socket-buffers-small", "resources", "machine.socket-buffers",
        "large messages arrive rarely or never, images stutter", _SMALL_BUFFERS, severity=Severity.WARNING,
        note="captured in a network namespace that was flooded", layer="loss"),
    FindingRow("under-voltage", "resources", "machine.heat", "USB devices drop out, the board resets, the SD card loses data",
        _CAPTURED_CASE, note=_NO_SENSORS),
    FindingRow("too-hot", "resources", "machine.heat", "nodes publish too slowly, images and scans come late", _CAPTURED_CASE,
        note=_NO_SENSORS),
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
