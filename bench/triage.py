"""The faults of a booted robot and its laptop: how to inject each, how to undo it, and the finding that the doctor must report.

The robot runs the vendor's stack on a simulated robot and Lupin's units, and its clock follows the laptop's.
"""

from __future__ import annotations

from bench.fault_case import (
    AUTO_HOME,
    ONBOARD,
    PROFILE,
    Action,
    Case,
    host_fault,
    no_action,
    node_fault,
    order_fault,
    participant_fault,
    port_fault,
    profile_fault,
    script_fault,
    stack_fault,
)
from bench.fault_rig import ADDRESS, NAME, OTHER_ADDRESS, PARTICIPANT, RELEASE, FaultRig, RigError
from lupin_runtime.ports import CONSOLE_PORT, DISCOVERY_PORT, ROSBRIDGE_PORT
from lupin_sim.host.host import PROJECT

UNSETTING_HOOK = "unset ROS_DISCOVERY_SERVER FASTRTPS_DEFAULT_PROFILES_FILE\n"


def _start_stale_daemon(rig: FaultRig) -> None:
    env = {**rig.sourced_env, "ROS_DISCOVERY_SERVER": f"{OTHER_ADDRESS}:{DISCOVERY_PORT}"}
    rig.start_participant("talker", env=env, name="stale-daemon", command_line_tag="ros2cli.daemon")


def _start_root_node(rig: FaultRig) -> None:
    profile = "/home/mirte/mirte_ws/install/super_client.xml"
    variables = {"ROS_DISCOVERY_SERVER": "127.0.0.1", "FASTRTPS_DEFAULT_PROFILES_FILE": profile}
    settings = [f"--setenv={name}={value}" for name, value in variables.items()]
    options = [f"--unit={ROOT_NODE_UNIT}", "--uid=root", f"--working-directory={PROJECT}", *settings]
    done = rig.host.robot.run_as_root("systemd-run", "--quiet", "--collect", *options, *PARTICIPANT, "talker")
    if done.status != 0:
        raise RigError(f"the node of root did not start: {done.stderr[-300:]}")
    rig.root(
        f"id=$(systemctl show -p InvocationID --value {ROOT_NODE_UNIT})\n"  # ignores the system journal of earlier starts
        'printed() { journalctl -q -o cat "_SYSTEMD_INVOCATION_ID=$id"; }\n'
        "for _ in $(seq 300); do printed | grep -qx up && exit; sleep 0.1; done; exit 1"
    )


def _lose_controllers(state: str) -> Action:
    # Auto-home would repair the controllers, so it is stopped first.
    def inject(rig: FaultRig) -> None:
        rig.root("u=lupin-auto-home; systemctl stop $u; systemctl disable -q $u; systemctl reset-failed $u || true")
        rig.host.robot.inject_fault("controllers-stuck", state=state)
        rig.root("systemctl enable -q lupin-auto-home")

    return inject


def _restore_controllers(rig: FaultRig) -> None:
    rig.host.robot.undo_fault("controllers-stuck")


def _stop_serving_time(rig: FaultRig) -> None:
    rig.host.robot.inject_fault("chrony-not-serving")
    rig.root("systemctl restart chrony")  # otherwise chrony counts a source that answered before as reachable


def _serve_time(rig: FaultRig) -> None:
    rig.host.robot.undo_fault("chrony-not-serving")
    rig.root("systemctl restart chrony")


def _reach_start_limit(rig: FaultRig) -> None:
    # The cause of the failures is removed, but systemd does not start the unit again.
    rig.host.robot.inject_fault("unit", state="failing")
    rig.root("rm -rf /run/systemd/system/lupin-onboard.service.d; systemctl daemon-reload")


def _undo_start_limit(rig: FaultRig) -> None:
    rig.host.robot.undo_fault("unit", state="failing")


def _let_logind_remove_memory(rig: FaultRig) -> None:
    from lupin_sim.host.checkout import LET_LOGIND_REMOVE_SHM

    rig.root(LET_LOGIND_REMOVE_SHM)


def _log_in_and_out(rig: FaultRig) -> None:
    # The real cause: the doctor's SSH login ends.
    _let_logind_remove_memory(rig)
    rig.doctor("--only", "link.*")
    rig.root("for _ in $(seq 300); do ls /dev/shm/fastrtps_* >/dev/null 2>&1 || exit 0; sleep 0.1; done; exit 1")


def _restore_memory(rig: FaultRig) -> None:
    from lupin_sim.host.checkout import keep_shared_memory

    keep_shared_memory(rig.host.robot)
    # Across many faults, the stack restarts more often than the start limits of its units allow.
    rig.root("systemctl reset-failed 'lupin-*'; systemctl restart mirte-ros", 90.0)


def _release_page_stop(rig: FaultRig) -> None:
    # The stop stays engaged after its page has disappeared, until the onboard unit is restarted.
    rig.stop_participant("stop")
    rig.root("systemctl restart lupin-onboard", 90.0)


def _append_workspace(text: str) -> str:
    return text + "source ~/mirte_ws/install/setup.bash\n"


def _install_workspace(rig: FaultRig) -> None:
    install = rig.home / "mirte_ws" / "install"
    rig.write(install / "share" / "mirte_bringup" / "environment" / "fastdds.sh", UNSETTING_HOOK)
    rig.write(install / "setup.bash", ". ~/mirte_ws/install/share/mirte_bringup/environment/fastdds.sh\n")
    bashrc = rig.home / ".bashrc"
    rig.write(bashrc, _append_workspace(bashrc.read_text()))


def _remove_setup(rig: FaultRig) -> None:
    for name in ("ros-env.sh", "fastdds_super_client.xml"):
        rig.write(rig.config_dir / name, None)
    rig.write(rig.home / ".bashrc", "# a shell\n")


TCP = "import socket, time; s = socket.create_server(('0.0.0.0', {port})); print('up', flush=True); time.sleep(1e6)"
UDP_PREFIX = 'prefix="44.53.00.5f.45.50.52.4f.53.49.4d.41"'
CLOCK_STEP_S = 300.0
ROOT_NODE_UNIT = "lupin-triage-talker"

CASES: tuple[Case, ...] = (
    # -- link
    host_fault("cable-cut", "cable-cut", "no-carrier", "link", unreachable=True, hides_graph=True),
    host_fault("switch-dead", "switch-dead", "robot-unreachable", "link", unreachable=True, hides_graph=True),
    host_fault("sshd-hung", "sshd-hung", "robot-unreachable", "link", unreachable=True),
    host_fault("sshd-down", "sshd-down", "robot-unreachable", "link", unreachable=True),
    host_fault("host-key-changed", "host-key-changed", "robot-unreachable", "link", unreachable=True),
    host_fault("wifi-roam", "wifi-roam", "robot-unreachable", "link", unreachable=True, robot=f"{NAME}-ap"),
    host_fault("dual-homed", "dual-homed", "robot-multi-homed", "link", hides_graph=True, hides=("vendor-stopped",)),
    # -- discovery
    stack_fault("race-port", "server-not-started", "discovery-server-missing", {"cause": "port"}),
    stack_fault("race-path", "server-not-started", "discovery-server-missing", {"cause": "path"}),
    stack_fault("server-killed", "server-killed", "discovery-server-missing"),
    host_fault(
        "server-pinned", "server-pinned", "discovery-server-pinned", "server", hides_graph=True, hides=("profile-address",)
    ),
    host_fault("server-stopped", "server-stopped", "discovery-server-stopped", "server", hides_graph=True),
    host_fault("server-port-taken", "server-port-taken", "discovery-port-taken", "server", hides_graph=True),
    stack_fault("dds-off", "dds-off", "discovery-server-switched-off"),
    # -- processes, shells, profiles
    node_fault("node-bare-shell", "process-multicast-only", ROS_DISCOVERY_SERVER=None, FASTRTPS_DEFAULT_PROFILES_FILE=None),
    node_fault("node-wrong-server", "process-wrong-server", ROS_DISCOVERY_SERVER=f"10.42.0.7:{DISCOVERY_PORT}"),
    profile_fault("profile-not-default", 'is_default_profile="true"', 'is_default_profile="false"', "profile-not-default"),
    profile_fault("profile-client", "SUPER_CLIENT", "CLIENT", "profile-not-super-client"),
    profile_fault("profile-prefix", UDP_PREFIX, UDP_PREFIX.replace("44.53.00", "44.53.07"), "profile-wrong-prefix"),
    profile_fault("profile-address", ADDRESS, OTHER_ADDRESS, "profile-wrong-address"),
    Case("shell-bare", frozenset({"shell-multicast-only"}), no_action, exclusive_group="shell", on_robot=False, shell="bare"),
    Case("shell-rmw", frozenset({"shell-rmw-mismatch"}), no_action, exclusive_group="shell", on_robot=False, shell="wrong-rmw"),
    Case(
        "source-order", frozenset({"source-order"}), _install_workspace, exclusive_group="shell", on_robot=False, shell="bare"
    ),
    Case(
        "set-up-taken-back",
        frozenset({"dds-not-set-up"}),
        _remove_setup,
        exclusive_group="shell",
        on_robot=False,
        shell="bare",
        hides_graph=True,
        takes=PROFILE,
        hides=("stale-daemon",),  # the set-up names the server that a daemon should use
    ),
    port_fault("page-port-taken", TCP.format(port=CONSOLE_PORT), "port-8090-taken", CONSOLE_PORT),
    port_fault("bridge-port-taken", TCP.format(port=ROSBRIDGE_PORT), "port-9090-taken", ROSBRIDGE_PORT),
    Case(
        "stale-daemon",
        frozenset({"stale-daemon"}),
        _start_stale_daemon,
        lambda rig: rig.stop_participant("stale-daemon"),
        on_robot=False,
    ),
    # -- stale resources
    host_fault("zombies", "zombies", "zombie-process", "stale-resources"),
    host_fault("shm-orphans", "shm-orphans", "shared-memory-orphans", "stale-resources"),
    host_fault("shm-full", "shm-full", "shared-memory-full", "stale-resources"),
    Case(
        "login-may-take-memory",
        frozenset({"shared-memory-at-risk"}),
        _let_logind_remove_memory,
        _restore_memory,
        "stale-resources",
    ),
    Case("login-took-memory", frozenset({"shared-memory-removed"}), _log_in_and_out, _restore_memory, "stale-resources"),
    Case(
        "node-of-root",
        frozenset({"shared-memory-not-shared"}),
        _start_root_node,
        lambda rig: rig.root(f"! systemctl -q is-active {ROOT_NODE_UNIT} || systemctl stop {ROOT_NODE_UNIT}"),
        "stale-resources",
    ),
    # -- units
    host_fault("auto-home-failed", "oneshot-failed", "oneshot-failed", "auto-home", needs=AUTO_HOME),
    host_fault("onboard-stopped", "unit", "unit-not-running", "onboard", {"state": "stopped"}, takes=ONBOARD),
    Case(
        "onboard-given-up",
        frozenset({"unit-start-limit"}),
        _reach_start_limit,
        _undo_start_limit,
        "onboard",
        takes=ONBOARD,
    ),
    host_fault("onboard-disabled", "unit", "unit-not-enabled", "onboard", {"state": "disabled"}),
    host_fault("onboard-masked", "unit", "unit-not-enabled", "onboard", {"state": "masked"}, takes=ONBOARD),
    script_fault(
        "unit-unread",
        "sleep 1; touch /etc/systemd/system/lupin-onboard.service",
        "systemctl daemon-reload",
        "units-need-reload",
        "onboard",
        needs=AUTO_HOME,
    ),
    script_fault(
        "vendor-stopped",
        "systemctl stop mirte-ros",
        # The onboard unit may still be masked; undoing that fault starts it.
        "systemctl start mirte-ros; systemctl start lupin-onboard || true; systemctl start --no-block lupin-auto-home",
        "vendor-service-down",
        "server",
        hides_graph=True,
        # Without the stack, no process owns cameras, shared memory or a graph.
        hides=("camera-held", "login-may-take-memory", "login-took-memory", "node-of-root"),
    ),
    # -- clocks
    host_fault("clock-wrong", "clock-wrong", "clock-drift", "clock", {"offset_s": CLOCK_STEP_S}),
    host_fault("chrony-stopped", "chrony-stopped", "chrony-not-running", "clock"),
    Case("laptop-not-serving", frozenset({"chrony-not-serving"}), _stop_serving_time, _serve_time, "clock"),
    host_fault("stock-makestep", "stock-makestep", "chrony-stock-makestep", "makestep"),
    # -- the graph
    Case(
        "controllers-unconfigured",
        frozenset({"controllers-not-active"}),
        _lose_controllers("unconfigured"),
        _restore_controllers,
        "server",
        needs_graph=True,
        takes=AUTO_HOME,
    ),
    Case(
        "controllers-unloaded",
        frozenset({"controllers-not-active"}),
        _lose_controllers("unloaded"),
        _restore_controllers,
        "server",
        needs_graph=True,
        takes=AUTO_HOME,
    ),
    order_fault(
        "controller-inactive",
        "switch deactivate mirte_base_controller",
        "switch activate mirte_base_controller",
        "controllers-not-active",
        "controllers",
        needs=AUTO_HOME,
    ),
    participant_fault("reader-wants-reliable", "reader", "qos-mismatch"),
    participant_fault("page-zeros", "page", "page-holds-bus", "bus", needs=ONBOARD),
    participant_fault("pad-zeros", "pad", "pad-holds-bus", "bus", needs=ONBOARD),
    Case(
        "page-stop",
        frozenset({"estop-engaged"}),
        lambda rig: rig.start_participant("stop"),
        _release_page_stop,
        "bus",
        needs_graph=True,
        needs=ONBOARD,
    ),
    order_fault("red-button", "press yes", "press no", "estop-engaged", "bus", needs=ONBOARD),
    participant_fault("wrong-sink", "sink", "drive-sink-unheard", needs=ONBOARD),
    order_fault("lidar-silent", "sim scan silent", "sim scan none", "topic-silent", "lidar"),
    order_fault("board-silent", "sim board silent", "sim board none", "board-wedged", "board"),
    order_fault("battery-low", "battery 0.1", "battery 0.85", "battery-low", "board"),
    order_fault("battery-nan", "sim battery nan", "sim battery none", "battery-unreadable", "board"),
    # -- the computer
    host_fault("disk-full", "disk-full", "disk-full", "disk"),
    host_fault("disk-read-only", "disk-read-only", "filesystem-read-only", "disk"),
    host_fault("camera-held", "camera-held", "camera-held", "camera"),
    host_fault("not-in-group", "not-in-group", "groups-missing", "account"),
    host_fault("home-locked", "home-locked", "home-not-writable", "account"),
    host_fault("no-python", "program-missing", "python-missing", "software", {"program": "python3"}),
    script_fault(
        "release-gone",
        f"mv /opt/lupin/releases/{RELEASE} /opt/lupin/releases/away",
        f"mv /opt/lupin/releases/away /opt/lupin/releases/{RELEASE}",
        "release-broken",
        "software",
    ),
    script_fault(
        "older-release",
        'cd /opt/lupin/current; cp release.json keep; sed -i \'s/"version": "[^"]*"/"version": "0.0.1"/\' release.json',
        "cd /opt/lupin/current; mv keep release.json",
        "version-skew",
        "software",
    ),
)
