"""Which test proves each finding of the doctor's table, and what the proof covers; docs/doctor.md lists it."""

from __future__ import annotations

from dataclasses import dataclass

# Tests that cause the fault on a booted robot or on a graph of real nodes.
_LINK = "tests/lupin_cli/doctor/test_doctor_on_host.py"
_SETUP = "tests/lupin_cli/doctor/test_setup_on_host.py"
_HEALTH = "tests/lupin_cli/checks/test_checks_on_host.py"
_PATH = "tests/lupin_cli/doctor/test_path_on_host.py"
_PACKETS = "tests/lupin_cli/link/test_path.py"
_CAMERAS = "tests/lupin_cli/systemd/test_cameras_on_host.py"
_GRAPH = "tests/lupin_cli/checks/test_graph_checks_on_host.py"
_PROBE = "tests/lupin_runtime/stack/test_graph_probe.py"
_BOARD = "tests/lupin_cli/checks/test_board_checks.py"  # with a simulated board on a pseudo-terminal
# Tests that judge output captured from a machine.
_SERVER_CAPTURES = "tests/lupin_cli/checks/test_discovery_checks.py"
_ENVIRONMENT_CAPTURES = "tests/lupin_cli/checks/test_environment_checks.py"
_PROFILE_CAPTURES = "tests/lupin_cli/checks/test_profile_checks.py"
_ADDRESS_CAPTURES = "tests/lupin_cli/checks/test_address_checks.py"
_LINK_CAPTURES = "tests/lupin_cli/checks/test_link_checks.py"
_HEALTH_CAPTURES = "tests/lupin_cli/checks/test_health_checks.py"
_CASES = "tests/lupin_cli/checks/test_captured_cases.py"
_GRAPH_CAPTURES = "tests/lupin_cli/checks/test_graph_checks.py"
_CAPTURES = (
    _SERVER_CAPTURES,
    _ENVIRONMENT_CAPTURES,
    _PROFILE_CAPTURES,
    _ADDRESS_CAPTURES,
    _LINK_CAPTURES,
    _HEALTH_CAPTURES,
    _CASES,
    _GRAPH_CAPTURES,
)


@dataclass(frozen=True)
class Proof:
    """A test, as file::test, and what it covers, or why it judges captured output; empty if its name says all."""

    test: str
    note: str = ""

    @property
    def captured(self) -> bool:
        """Whether the test judges captured output instead of causing the fault."""
        return self.test.partition("::")[0] in _CAPTURES


_DAMAGED_RELEASE = "tests/lupin_cli/release/test_signing_on_host.py::test_changed_byte_is_named_refused_and_repaired"
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
_CAPTURED_CASE = f"{_CASES}::test_captured_fault_is_named_alone"
_SILENT = f"{_GRAPH}::test_silent_sensor_and_silent_board_are_distinguished"
_GRAPH_FAULTS = f"{_GRAPH}::test_simultaneous_graph_faults_are_each_named"
_ZEROS = f"{_GRAPH}::test_gamepad_zeros_and_type_mismatch_are_named"
_REAL_NODES = f"{_PROBE}::test_faults_of_real_nodes_give_exactly_their_findings"
_CAMERA_FAULTS = f"{_CAMERAS}::test_each_fault_of_a_camera_is_named_alone"
_LATE_JOINER = f"{_PROBE}::test_separate_shared_memory_is_found_and_udp_fixes_it"
_HOST_MEMORY = "the simulated computer uses the memory of this machine and has no limit of its own"
_NO_USB = "the simulated computer has no USB"
_NO_SENSORS = "the simulated computer has no temperature or voltage sensors"

# fmt: off
PROOFS = {
    "unexplained": Proof(f"{_PATH}::test_loss_that_no_check_explains_is_a_finding"),
    "part-missing": Proof(f"{_GRAPH_CAPTURES}::test_part_without_publishers_is_named_with_its_unit",
        "the simulated robot is one process, of which no part can be missing"),
    "no-carrier": Proof(_UNREACHABLE),
    "wifi-roamed": Proof(f"{_ADDRESS_CAPTURES}::test_roamed_wifi_explains_unreachable_robot",
        "the simulated laptop runs no NetworkManager; the simulator's fault `wifi-roam` only removes its route"),
    "wifi-may-roam": Proof(f"{_ADDRESS_CAPTURES}::test_equal_wifi_priorities_warn_only_over_radio",
        "the simulated laptop runs no NetworkManager"),
    "network-conflict": Proof(f"{_LINK_CAPTURES}::test_own_address_of_the_laptop_is_no_robot",
        "the simulated laptop has the addresses that the simulated robot gives it"),
    "address-missing": Proof(f"{_PACKETS}::test_lost_address_is_named_on_its_machine"),
    "route-elsewhere": Proof(f"{_PACKETS}::test_route_over_another_interface_is_named"),
    "no-route": Proof(f"{_PACKETS}::test_missing_route_is_named_on_its_machine"),
    "neighbor-wrong": Proof(f"{_PACKETS}::test_permanent_neighbor_entry_is_named"),
    "link-dead": Proof(f"{_PACKETS}::test_dead_switch_lies_between_the_interfaces"),
    "large-packets-lost": Proof(f"{_PACKETS}::test_small_mtu_is_named_on_its_machine"),
    "packets-lost": Proof(f"{_PACKETS}::test_random_loss_is_no_firewall"),
    "udp-lost": Proof(f"{_PACKETS}::test_blocked_ports_are_named_with_direction_and_machine"),
    "socket-not-read": Proof(f"{_PACKETS}::test_program_that_does_not_read_its_socket_is_named"),
    "robot-unreachable": Proof(_UNREACHABLE, "covers: no route, timeout, connection refused, no answer, changed host key"),
    "discovery-server-missing": Proof(f"{_LINK}::test_missing_discovery_server_is_the_only_root_cause"),
    "discovery-server-switched-off": Proof(f"{_LINK}::test_vendor_stack_on_multicast_is_the_only_root_cause"),
    "discovery-port-taken": Proof(_BAD_SERVER),
    "discovery-server-stopped": Proof(_BAD_SERVER),
    "discovery-server-pinned": Proof(_BAD_SERVER),
    "discovery-server-other-id": Proof(f"{_SERVER_CAPTURES}::test_server_with_another_id_is_named",
        "the command line is judged from captured output"),
    "robot-multi-homed": Proof(f"{_LINK}::test_announced_address_without_route_is_named"),
    "process-older-than-interface": Proof(f"{_LINK}::test_process_older_than_link_address_is_named"),
    "process-multicast-only": Proof(f"{_SETUP}::test_node_from_unconfigured_shell_is_the_only_root_cause"),
    "process-wrong-server": Proof(f"{_SETUP}::test_node_with_wrong_server_is_the_only_root_cause"),
    "rmw-mismatch": Proof(f"{_ENVIRONMENT_CAPTURES}::test_process_on_another_middleware_is_named",
        "only Fast DDS is installed in the test environment"),
    "dds-not-set-up": Proof(_BAD_SHELL),
    "source-order": Proof(f"{_SETUP}::test_wrong_source_order_is_the_only_root_cause"),
    "shell-multicast-only": Proof(_BAD_SHELL),
    "shell-without-profile": Proof(f"{_ENVIRONMENT_CAPTURES}::test_shell_without_the_profile_is_named",
        "the variables are judged from captured output"),
    "shell-rmw-mismatch": Proof(_BAD_SHELL),
    "shell-other-graph": Proof(f"{_ENVIRONMENT_CAPTURES}::test_shell_variables_that_lead_elsewhere_are_named",
        "the variables are judged from captured output"),
    "shell-wrong-server": Proof(f"{_PATH}::test_wrong_port_is_named"),
    "shell-program-fails": Proof(f"{_ENVIRONMENT_CAPTURES}::test_program_that_fails_in_this_shell_is_named",
        "the error is judged from captured output"),
    "stale-daemon": Proof(f"{_SETUP}::test_stale_ros2_daemon_is_the_only_root_cause",
        "the test starts a node with the daemon's command line, because the ROS wheels contain no ros2 command"),
    "profile-unreadable": Proof(_NO_SERVER),
    "profile-not-default": Proof(_BAD_PROFILE),
    "profile-not-super-client": Proof(_BAD_PROFILE),
    "profile-wrong-prefix": Proof(_BAD_PROFILE),
    "profile-without-server": Proof(_NO_SERVER),
    "profile-excludes-link": Proof(f"{_PROFILE_CAPTURES}::test_profile_that_excludes_the_link_is_named",
        "the files are judged from captured output"),
    "profile-wrong-address": Proof(_BAD_PROFILE),
    "profile-changed": Proof(f"{_PROFILE_CAPTURES}::test_process_older_than_its_profile_is_named",
        "the ages are judged from captured output"),
    "process-stopped": Proof(f"{_PATH}::test_stopped_process_of_a_service_is_the_only_root",
        "without asking if it is the e-stop"),
    "zombie-process": Proof(f"{_LINK}::test_stopped_process_on_dds_ports_is_the_only_root_cause"),
    "shared-memory-not-shared": Proof(f"{_LINK}::test_node_of_root_that_shares_no_memory_is_found"),
    "shared-memory-at-risk": Proof(_LOGIND),
    "shared-memory-removed": Proof(_LOGIND),
    "shared-memory-orphans": Proof(f"{_LINK}::test_memory_of_killed_participant_is_the_only_root_cause"),
    "port-8090-taken": Proof(_PORT),
    "port-9090-taken": Proof(_PORT),
    "port-123-taken": Proof(_PORT),
    "port-8091-taken": Proof(f"{_CAMERAS}::test_program_on_camera_port_is_named"),
    "python-missing": Proof(_PREREQUISITE),
    "not-deployed": Proof(_RELEASE),
    "release-broken": Proof(_RELEASE),
    "python-changed": Proof(_RELEASE),
    "version-skew": Proof(_RELEASE),
    "release-damaged": Proof(_DAMAGED_RELEASE),
    "release-unsigned": Proof(_CAPTURED_CASE),
    "groups-missing": Proof(_PREREQUISITE),
    "home-not-writable": Proof(_PREREQUISITE),
    "unit-environment": Proof(f"{_ENVIRONMENT_CAPTURES}::test_unit_environment_that_leads_elsewhere_is_named",
        "only Fast DDS is installed in the test environment"),
    "process-environment": Proof(f"{_ENVIRONMENT_CAPTURES}::test_environment_of_robot_processes_is_judged",
        "the variables are judged from captured output"),
    "unit-frozen": Proof(f"{_HEALTH_CAPTURES}::test_frozen_and_restricted_units_are_parsed_and_named",
        "the simulated computer's kernel freezes no control group"),
    "unit-without-network": Proof(f"{_HEALTH_CAPTURES}::test_frozen_and_restricted_units_are_parsed_and_named",
        "the simulated computer's kernel filters no control group"),
    "vendor-service-down": Proof(f"{_HEALTH}::test_stopped_vendor_service_explains_its_consequences"),
    "unit-missing": Proof(f"{_HEALTH}::test_unit_missing_after_deploy_is_named"),
    "oneshot-failed": Proof(f"{_HEALTH}::test_failed_oneshot_shows_its_journal_lines"),
    "unit-start-limit": Proof(_STOPPED_UNIT),
    "unit-failed": Proof(_FAILED_UNIT),
    "unit-restarting": Proof(_FAILED_UNIT),
    "unit-not-running": Proof(_STOPPED_UNIT),
    "unit-starting": Proof(f"{_HEALTH_CAPTURES}::test_unit_that_never_gets_ready_is_named", "judged from captured output"),
    "unit-not-enabled": Proof(f"{_HEALTH}::test_disabled_unit_and_unread_unit_file_are_named"),
    "unit-outlived-vendor": Proof(f"{_HEALTH}::test_unit_not_restarted_with_vendor_is_named"),
    "run-interrupted": Proof(f"{_CASES}::test_captured_fault_is_named_alone"),
    "units-need-reload": Proof(f"{_HEALTH}::test_disabled_unit_and_unread_unit_file_are_named"),
    "clock-drift": Proof(f"{_HEALTH}::test_clock_offset_is_named_with_its_uncertainty"),
    "chrony-stock-makestep": Proof(f"{_HEALTH}::test_stock_makestep_is_named"),
    "chrony-missing": Proof(_TIME_SOURCE),
    "chrony-not-running": Proof(f"{_HEALTH}::test_stopped_chrony_is_named"),
    "other-time-daemon": Proof(f"{_HEALTH_CAPTURES}::test_other_time_daemon_is_named",
        "the simulated robot has no other time daemon"),
    "chrony-sources-silent": Proof(_TIME_SOURCE),
    "chrony-not-serving": Proof(f"{_HEALTH}::test_laptop_not_serving_time_is_named"),
    "type-mismatch": Proof(_ZEROS),
    "qos-mismatch": Proof(_GRAPH_FAULTS),
    "frame-wrong": Proof(_REAL_NODES),
    "stamps-wrong": Proof(_REAL_NODES),
    "names-no-samples": Proof(_LATE_JOINER),
    "one-way-data": Proof(f"{_GRAPH}::test_multihomed_robot_shows_one_way_data"),
    "topic-silent": Proof(_SILENT),
    "camera-silent": Proof(_SILENT),
    "graph-not-visited": Proof(f"{_GRAPH_CAPTURES}::test_failed_graph_probe_is_named"),
    "controllers-not-active": Proof(f"{_GRAPH}::test_unconfigured_controllers_explain_silent_topics"),
    "controller-manager-missing": Proof(_REAL_NODES),
    "controller-manager-silent": Proof(f"{_GRAPH_CAPTURES}::test_hanging_controller_manager_differs_from_one_way_link",
        "the simulated controller manager shares a process with other nodes and cannot hang alone"),
    "drive-sink-unheard": Proof(_GRAPH_FAULTS),
    "estop-engaged": Proof(_REAL_NODES),
    "bus-locked": Proof(f"{_GRAPH_CAPTURES}::test_engaged_stop_names_its_holder_and_explains_bus_lock"),
    "drive-bypassed": Proof(_REAL_NODES),
    "estop-forged": Proof(_REAL_NODES),
    "page-holds-bus": Proof(_GRAPH_FAULTS),
    "pad-holds-bus": Proof(_ZEROS),
    "board-held": Proof(f"{_BOARD}::test_process_that_holds_the_port_is_named"),
    "board-firmware-wrong": Proof(f"{_BOARD}::test_board_with_another_program_is_named"),
    "board-unpowered": Proof(_CAPTURED_CASE, _NO_USB),
    "board-absent": Proof(_CAPTURED_CASE, _NO_USB),
    "board-wedged": Proof(_SILENT, "the USB devices and the kernel's messages are judged from captured output; "
        "a port without answers is simulated in `test_board_checks.py`"),
    "serial-port-closed": Proof(f"{_GRAPH_CAPTURES}::test_serial_port_that_the_user_may_not_open_is_named",
        "the simulated computer has no serial port"),
    "battery-unreadable": Proof(_REAL_NODES),
    "battery-low": Proof(_GRAPH_FAULTS),
    "camera-held": Proof(f"{_HEALTH}::test_stray_camera_holder_is_named_with_its_pid",
        "the simulated computer has no camera: the test opens a regular file, /dev/video0"),
    "camera-absent": Proof(_CAMERA_FAULTS),
    "camera-driver-missing": Proof(_CAMERA_FAULTS),
    "camera-driver-failing": Proof(_CAMERA_FAULTS),
    "filesystem-read-only": Proof(_DISK),
    "shared-memory-full": Proof(f"{_HEALTH}::test_full_shared_memory_is_named"),
    "disk-full": Proof(_DISK),
    "inodes-used-up": Proof(f"{_HEALTH}::test_used_up_inodes_are_named"),
    "memory-low": Proof(_CAPTURED_CASE, _HOST_MEMORY),
    "killed-for-memory": Proof(_CAPTURED_CASE, _HOST_MEMORY),
    "socket-buffers-small": Proof(_SMALL_BUFFERS, "captured in a network namespace that was flooded"),
    "under-voltage": Proof(_CAPTURED_CASE, _NO_SENSORS),
    "too-hot": Proof(_CAPTURED_CASE, _NO_SENSORS),
}
# fmt: on
