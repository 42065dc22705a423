"""The faults of the triage benchmark: how to inject each, how to undo it, and the finding that the doctor must report.

A case that injects a fault of `lupin sim host fault` has the name of that fault, where it is the only case with it. For the two
machines, see `bench.fault_rig`.
"""

from __future__ import annotations

from bench.fault_case import (
    AUTO_HOME,
    ONBOARD,
    PROFILE,
    Action,
    FaultCase,
    command_fault,
    host_fault,
    no_action,
    node_fault,
    participant_fault,
    port_fault,
    profile_fault,
    script_fault,
    vendor_stack_fault,
)
from bench.fault_rig import AP_ADDRESS, ORIGINAL_BASHRC, PARTICIPANT, RELEASE, ROBOT, WIRED_ADDRESS, FaultRig, RigError
from lupin_runtime.ports import CONSOLE_PORT, DISCOVERY_PORT, ROSBRIDGE_PORT
from lupin_sim.host.host import PROJECT

ROOT_NODE_UNIT = "lupin-fault-root-node"
# A hook of the vendor's workspace, which its setup.bash sources. Sourced after ros-env.sh, it undoes what that has set.
UNSET_DDS_ENVIRONMENT_HOOK = "unset ROS_DISCOVERY_SERVER FASTRTPS_DEFAULT_PROFILES_FILE\n"


def _start_stale_daemon(rig: FaultRig) -> None:
    env = {**rig.sourced_env, "ROS_DISCOVERY_SERVER": f"{AP_ADDRESS}:{DISCOVERY_PORT}"}
    rig.start_participant("talker", env=env, name="stale-daemon", command_line_tag="ros2cli.daemon")


def _start_node_as_root(rig: FaultRig) -> None:
    profile = "/home/mirte/mirte_ws/install/super_client.xml"
    variables = {"ROS_DISCOVERY_SERVER": "127.0.0.1", "FASTRTPS_DEFAULT_PROFILES_FILE": profile}
    settings = [f"--setenv={name}={value}" for name, value in variables.items()]
    options = [f"--unit={ROOT_NODE_UNIT}", "--uid=root", f"--working-directory={PROJECT}", *settings]
    done = rig.machines.robot.run_as_root("systemd-run", "--quiet", "--collect", *options, *PARTICIPANT, "talker")
    if done.status != 0:
        raise RigError(f"the node that runs as root did not start: {done.stderr[-300:]}")
    rig.run_as_root(
        f"id=$(systemctl show -p InvocationID --value {ROOT_NODE_UNIT})\n"  # ignores the system journal of earlier starts
        'printed() { journalctl -q -o cat "_SYSTEMD_INVOCATION_ID=$id"; }\n'
        "for _ in $(seq 300); do printed | grep -qx up && exit; sleep 0.1; done; exit 1"
    )


def _stuck_controllers_action(state: str) -> Action:
    """Return the action that restarts the vendor's stack so that its controllers stay in this state."""

    def inject(rig: FaultRig) -> None:
        # Auto-home would activate the controllers, so it is stopped, and cannot be started before they are stuck.
        rig.run_as_root("u=lupin-auto-home; systemctl stop $u; systemctl disable -q $u; systemctl reset-failed $u || true")
        rig.machines.robot.inject_fault("controllers-stuck", state=state)
        # The onboard unit starts again with the vendor's stack. Until it has, that is a finding of its own.
        rig.run_as_root("systemctl enable -q lupin-auto-home; systemctl start lupin-onboard", 90.0)

    return inject


def _activate_controllers(rig: FaultRig) -> None:
    rig.machines.robot.undo_fault("controllers-stuck")


# The fault is in the laptop's chronyd. The robot's chronyd is restarted, because it counts a source that answered before as
# reachable.
def _stop_laptop_time_server(rig: FaultRig) -> None:
    rig.machines.robot.inject_fault("chrony-not-serving")
    rig.run_as_root("systemctl restart chrony")


def _start_laptop_time_server(rig: FaultRig) -> None:
    rig.machines.robot.undo_fault("chrony-not-serving")
    rig.run_as_root("systemctl restart chrony")


def _reach_start_limit(rig: FaultRig) -> None:
    # The cause of the failures is removed, but systemd does not start the unit again.
    rig.machines.robot.inject_fault("unit", state="failing")
    rig.run_as_root("rm -rf /run/systemd/system/lupin-onboard.service.d; systemctl daemon-reload")


def _undo_start_limit(rig: FaultRig) -> None:
    rig.machines.robot.undo_fault("unit", state="failing")


def _let_logind_remove_shared_memory(rig: FaultRig) -> None:
    from lupin_sim.host.checkout import LET_LOGIND_REMOVE_SHM

    rig.run_as_root(LET_LOGIND_REMOVE_SHM)


def _log_in_and_out(rig: FaultRig) -> None:
    # As on a real robot: when the SSH session of the doctor ends, logind removes the shared memory.
    _let_logind_remove_shared_memory(rig)
    rig.run_doctor("--only", "link.*")
    rig.run_as_root("for _ in $(seq 300); do ls /dev/shm/fastrtps_* >/dev/null 2>&1 || exit 0; sleep 0.1; done; exit 1")


def _restore_shared_memory(rig: FaultRig) -> None:
    from lupin_sim.host.checkout import keep_shared_memory

    keep_shared_memory(rig.machines.robot)
    # Across many faults, the vendor's stack restarts more often than the start limits of Lupin's units allow.
    rig.run_as_root("systemctl reset-failed 'lupin-*'; systemctl restart mirte-ros", 90.0)


def _release_page_stop(rig: FaultRig) -> None:
    # The stop stays engaged after its page has disappeared, until the onboard unit is restarted.
    rig.stop_process("stop")
    rig.run_as_root("systemctl restart lupin-onboard", 90.0)


def _source_workspace_last(rig: FaultRig) -> None:
    install = rig.home / "mirte_ws" / "install"
    rig.write_file(install / "share" / "mirte_bringup" / "environment" / "fastdds.sh", UNSET_DDS_ENVIRONMENT_HOOK)
    rig.write_file(install / "setup.bash", ". ~/mirte_ws/install/share/mirte_bringup/environment/fastdds.sh\n")
    bashrc = rig.home / ".bashrc"
    rig.write_file(bashrc, bashrc.read_text() + "source ~/mirte_ws/install/setup.bash\n")


def _remove_dds_setup(rig: FaultRig) -> None:
    for name in ("ros-env.sh", "fastdds_super_client.xml"):
        rig.write_file(rig.config_dir / name, None)
    rig.write_file(rig.home / ".bashrc", ORIGINAL_BASHRC)


TCP_LISTENER = "import socket, time; s = socket.create_server(('0.0.0.0', {port})); print('up', flush=True); time.sleep(1e6)"
SERVER_GUID_PREFIX = (
    'prefix="44.53.00.5f.45.50.52.4f.53.49.4d.41"'  # of a discovery server with the id 0, in a client's profile
)
CLOCK_OFFSET_S = 300.0

CASES: tuple[FaultCase, ...] = (
    # -- link
    host_fault("cable-cut", expected="no-carrier", group="link", unreachable=True, hides_graph=True),
    host_fault("switch-dead", expected="robot-unreachable", group="link", unreachable=True, hides_graph=True),
    host_fault("sshd-hung", expected="robot-unreachable", group="link", unreachable=True),
    host_fault("sshd-down", expected="robot-unreachable", group="link", unreachable=True),
    host_fault("host-key-changed", expected="robot-unreachable", group="link", unreachable=True),
    host_fault("wifi-roam", expected="robot-unreachable", group="link", unreachable=True, robot=f"{ROBOT}-ap"),
    host_fault("dual-homed", expected="robot-multi-homed", group="link", hides_graph=True, hides=("vendor-stopped",)),
    # -- discovery
    vendor_stack_fault(
        "server-not-started-port", fault="server-not-started", expected="discovery-server-missing", settings={"cause": "port"}
    ),
    vendor_stack_fault(
        "server-not-started-path", fault="server-not-started", expected="discovery-server-missing", settings={"cause": "path"}
    ),
    vendor_stack_fault("server-killed", expected="discovery-server-missing"),
    host_fault(
        "server-pinned", expected="discovery-server-pinned", group="vendor-stack", hides_graph=True, hides=("profile-address",)
    ),
    host_fault("server-stopped", expected="discovery-server-stopped", group="vendor-stack", hides_graph=True),
    host_fault("server-port-taken", expected="discovery-port-taken", group="vendor-stack", hides_graph=True),
    vendor_stack_fault("dds-off", expected="discovery-server-switched-off"),
    # -- processes, shells, profiles
    node_fault(
        "node-bare-shell", expected="process-multicast-only", ROS_DISCOVERY_SERVER=None, FASTRTPS_DEFAULT_PROFILES_FILE=None
    ),
    node_fault("node-wrong-server", expected="process-wrong-server", ROS_DISCOVERY_SERVER=f"10.42.0.7:{DISCOVERY_PORT}"),
    profile_fault(
        "profile-not-default", 'is_default_profile="true"', 'is_default_profile="false"', expected="profile-not-default"
    ),
    profile_fault("profile-client", "SUPER_CLIENT", "CLIENT", expected="profile-not-super-client"),
    profile_fault(
        "profile-prefix",
        SERVER_GUID_PREFIX,
        SERVER_GUID_PREFIX.replace("44.53.00", "44.53.07"),
        expected="profile-wrong-prefix",
    ),
    profile_fault("profile-address", WIRED_ADDRESS, AP_ADDRESS, expected="profile-wrong-address"),
    FaultCase(
        "shell-bare", frozenset({"shell-multicast-only"}), no_action, exclusive_group="shell", on_robot=False, shell="bare"
    ),
    FaultCase(
        "shell-rmw", frozenset({"shell-rmw-mismatch"}), no_action, exclusive_group="shell", on_robot=False, shell="wrong-rmw"
    ),
    FaultCase(
        "source-order",
        frozenset({"source-order"}),
        _source_workspace_last,
        exclusive_group="shell",
        on_robot=False,
        shell="bare",
    ),
    FaultCase(
        "dds-setup-removed",
        frozenset({"dds-not-set-up"}),
        _remove_dds_setup,
        exclusive_group="shell",
        on_robot=False,
        shell="bare",
        hides_graph=True,
        removes=PROFILE,
        hides=("stale-daemon",),  # without the setup, the server that a daemon should use is unknown
    ),
    port_fault("console-port-taken", TCP_LISTENER.format(port=CONSOLE_PORT), expected="port-8090-taken", port=CONSOLE_PORT),
    port_fault(
        "rosbridge-port-taken", TCP_LISTENER.format(port=ROSBRIDGE_PORT), expected="port-9090-taken", port=ROSBRIDGE_PORT
    ),
    FaultCase(
        "stale-daemon",
        frozenset({"stale-daemon"}),
        _start_stale_daemon,
        lambda rig: rig.stop_process("stale-daemon"),
        on_robot=False,
    ),
    # -- stale resources
    host_fault("zombies", expected="zombie-process", group="stale-resources"),
    host_fault("shm-orphans", expected="shared-memory-orphans", group="stale-resources"),
    host_fault("shm-full", expected="shared-memory-full", group="stale-resources"),
    FaultCase(
        "logout-may-remove-shm",
        frozenset({"shared-memory-at-risk"}),
        _let_logind_remove_shared_memory,
        _restore_shared_memory,
        "stale-resources",
    ),
    FaultCase(
        "logout-removed-shm", frozenset({"shared-memory-removed"}), _log_in_and_out, _restore_shared_memory, "stale-resources"
    ),
    FaultCase(
        "node-run-as-root",
        frozenset({"shared-memory-not-shared"}),
        _start_node_as_root,
        lambda rig: rig.run_as_root(f"! systemctl -q is-active {ROOT_NODE_UNIT} || systemctl stop {ROOT_NODE_UNIT}"),
        "stale-resources",
    ),
    # -- units
    host_fault("auto-home-failed", fault="oneshot-failed", expected="oneshot-failed", group="auto-home", needs=AUTO_HOME),
    host_fault(
        "onboard-stopped",
        fault="unit",
        expected="unit-not-running",
        group="onboard",
        settings={"state": "stopped"},
        removes=ONBOARD,
    ),
    FaultCase(
        "onboard-start-limit",
        frozenset({"unit-start-limit"}),
        _reach_start_limit,
        _undo_start_limit,
        "onboard",
        removes=ONBOARD,
    ),
    host_fault("onboard-disabled", fault="unit", expected="unit-not-enabled", group="onboard", settings={"state": "disabled"}),
    host_fault(
        "onboard-masked",
        fault="unit",
        expected="unit-not-enabled",
        group="onboard",
        settings={"state": "masked"},
        removes=ONBOARD,
    ),
    script_fault(
        "unit-file-changed",
        inject="sleep 1; touch /etc/systemd/system/lupin-onboard.service",
        undo="systemctl daemon-reload",
        expected="units-need-reload",
        group="onboard",
        needs=AUTO_HOME,
    ),
    script_fault(
        "vendor-stopped",
        inject="systemctl stop mirte-ros",
        # The onboard unit may still be masked; undoing that fault starts it.
        undo="systemctl start mirte-ros; systemctl start lupin-onboard || true; systemctl start --no-block lupin-auto-home",
        expected="vendor-service-down",
        group="vendor-stack",
        hides_graph=True,
        # Without the vendor's stack, no process owns cameras, shared memory or a graph.
        hides=("camera-held", "logout-may-remove-shm", "logout-removed-shm", "node-run-as-root"),
    ),
    # -- clocks
    host_fault("clock-wrong", expected="clock-drift", group="clock", settings={"offset_s": CLOCK_OFFSET_S}),
    host_fault("chrony-stopped", expected="chrony-not-running", group="clock"),
    FaultCase(
        "laptop-not-serving", frozenset({"chrony-not-serving"}), _stop_laptop_time_server, _start_laptop_time_server, "clock"
    ),
    host_fault("stock-makestep", expected="chrony-stock-makestep", group="makestep"),
    # -- the graph
    FaultCase(
        "controllers-unconfigured",
        frozenset({"controllers-not-active"}),
        _stuck_controllers_action("unconfigured"),
        _activate_controllers,
        "vendor-stack",
        needs_graph=True,
        removes=AUTO_HOME,
    ),
    FaultCase(
        "controllers-unloaded",
        frozenset({"controllers-not-active"}),
        _stuck_controllers_action("unloaded"),
        _activate_controllers,
        "vendor-stack",
        needs_graph=True,
        removes=AUTO_HOME,
    ),
    command_fault(
        "controller-inactive",
        inject="switch deactivate mirte_base_controller",
        undo="switch activate mirte_base_controller",
        expected="controllers-not-active",
        group="controllers",
        needs=AUTO_HOME,
    ),
    participant_fault("reader-wants-reliable", role="reader", expected="qos-mismatch"),
    participant_fault("page-sends-zeros", role="page", expected="page-holds-bus", group="bus", needs=ONBOARD),
    participant_fault("gamepad-sends-zeros", role="gamepad", expected="pad-holds-bus", group="bus", needs=ONBOARD),
    FaultCase(
        "page-stop",
        frozenset({"estop-engaged"}),
        lambda rig: rig.start_participant("stop"),
        _release_page_stop,
        "bus",
        needs_graph=True,
        needs=ONBOARD,
    ),
    command_fault("red-button", inject="press yes", undo="press no", expected="estop-engaged", group="bus", needs=ONBOARD),
    participant_fault("wrong-sink", role="sink", expected="drive-sink-unheard", needs=ONBOARD),
    command_fault("lidar-silent", inject="sim scan silent", undo="sim scan none", expected="topic-silent", group="lidar"),
    command_fault("board-silent", inject="sim board silent", undo="sim board none", expected="board-wedged", group="board"),
    command_fault("battery-low", inject="battery 0.1", undo="battery 0.85", expected="battery-low", group="board"),
    command_fault(
        "battery-nan", inject="sim battery nan", undo="sim battery none", expected="battery-unreadable", group="board"
    ),
    # -- the computer
    host_fault("disk-full", expected="disk-full", group="disk"),
    host_fault("disk-read-only", expected="filesystem-read-only", group="disk"),
    host_fault("camera-held", expected="camera-held", group="camera"),
    host_fault("not-in-group", expected="groups-missing", group="account"),
    host_fault("home-locked", expected="home-not-writable", group="account"),
    host_fault(
        "no-python", fault="program-missing", expected="python-missing", group="software", settings={"program": "python3"}
    ),
    script_fault(
        "release-gone",
        inject=f"mv /opt/lupin/releases/{RELEASE} /opt/lupin/releases/away",
        undo=f"mv /opt/lupin/releases/away /opt/lupin/releases/{RELEASE}",
        expected="release-broken",
        group="software",
    ),
    script_fault(
        "older-release",
        inject='cd /opt/lupin/current; cp release.json keep; sed -i \'s/"version": "[^"]*"/"version": "0.0.1"/\' release.json',
        undo="cd /opt/lupin/current; mv keep release.json",
        expected="version-skew",
        group="software",
    ),
)
