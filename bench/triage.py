"""The faults of a booted robot and its laptop: how to inject each, how to undo it, and the finding it must lead to.

The robot runs the vendor's stack on a simulated robot, Lupin's units, and a clock that it takes from the laptop.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from bench.fault_rig import ADDRESS, NAME, OTHER_ADDRESS, PARTICIPANT, RELEASE, START_STOPPED_UNITS, Rig, RigError
from lupin_sim.host.host import PROJECT

UNSETTING_HOOK = "unset ROS_DISCOVERY_SERVER FASTRTPS_DEFAULT_PROFILES_FILE\n"
Action = Callable[[Rig], object]

# Faults of the drive bus: the onboard unit publishes their evidence, so they are invisible while it is down.
NEED_ONBOARD = ("page-zeros", "pad-zeros", "page-stop", "red-button", "wrong-sink")
# Auto-home is stopped and disabled while controllers are lost: systemd forgets its failure and reads all unit files again.
NEED_AUTO_HOME = ("controller-inactive", "auto-home-failed", "unit-unread")
NEED_PROFILE = ("profile-not-default", "profile-client", "profile-prefix", "profile-address")


def no_action(_: Rig) -> None:
    """Nothing to do: `Rig.restore` or undoing other faults undoes this one too."""


@dataclass(frozen=True)
class Case:
    """One fault. Cases of the same `group` exclude each other."""

    name: str
    expected: frozenset[str]
    inject: Action
    undo: Action = no_action
    group: str = ""
    ends_graph: bool = False  # the doctor sees nothing of the robot's graph while it lasts
    needs_graph: bool = False
    unreachable: bool = False  # the robot cannot be asked
    on_robot: bool = True  # its evidence is on the robot
    shell: str = "sourced"  # the environment in which the doctor runs
    robot: str = NAME  # the inventory's name under which the doctor reaches it
    hides: tuple[str, ...] = ()  # cases whose evidence this one removes

    def fits(self, other: Case) -> bool:
        """Whether both can exist, and be detected, at the same time."""
        if (self.group and self.group == other.group) or self.name in other.hides or other.name in self.hides:
            return False
        if (self.ends_graph and other.needs_graph) or (other.ends_graph and self.needs_graph):
            return False
        if (self.unreachable and other.on_robot) or (other.unreachable and self.on_robot):
            return False
        return len({self.shell, other.shell} - {"sourced"}) <= 1 and self.robot == other.robot


def host_fault(
    name: str, fault: str, expected: str, group: str = "", settings: Mapping[str, Any] | None = None, **more: Any
) -> Case:
    """A fault of `lupin sim host fault`."""
    chosen = dict(settings or {})
    return Case(
        name,
        frozenset({expected}),
        lambda rig: rig.host.robot.inject_fault(fault, **chosen),
        lambda rig: rig.host.robot.undo_fault(fault, **chosen),
        group,
        **more,
    )


def stack_fault(name: str, fault: str, expected: str, settings: Mapping[str, Any] | None = None) -> Case:
    """A fault with which the vendor's stack is restarted. As after a boot, Lupin's units start beside it."""
    chosen = dict(settings or {})

    def inject(rig: Rig) -> None:
        rig.host.robot.inject_fault(fault, **chosen)
        rig.root(START_STOPPED_UNITS, 90.0)

    return Case(
        name, frozenset({expected}), inject, host_fault(name, fault, expected, settings=chosen).undo, "server", ends_graph=True
    )


def participant_fault(name: str, role: str, expected: str, group: str = "") -> Case:
    """A fault that a participant of the graph on the laptop causes."""
    return Case(
        name,
        frozenset({expected}),
        lambda rig: rig.start_participant(role),
        lambda rig: rig.end_participant(role),
        group or role,
        needs_graph=True,
    )


def order_fault(name: str, inject: str, undo: str, expected: str, group: str) -> Case:
    """A fault that one order to the simulated robot causes and another undoes."""
    return Case(
        name,
        frozenset({expected}),
        lambda rig: rig.start_participant(*inject.split()),
        lambda rig: rig.start_participant(*undo.split()),
        group,
        needs_graph=True,
    )


def file_fault(name: str, path: str, change: Callable[[str], str | None], expected: str, group: str, **more: Any) -> Case:
    """A wrong file in the operator's home."""

    def inject(rig: Rig) -> None:
        place = rig.home / path
        rig.write(place, change(place.read_text() if place.exists() else ""))

    return Case(name, frozenset({expected}), inject, group=group, on_robot=False, **more)


def profile_fault(name: str, old: str, new: str, expected: str) -> Case:
    """A wrong value in the super client's profile."""

    def change(text: str) -> str:
        if old not in text:
            raise RigError(f"the profile holds no {old!r}")
        return text.replace(old, new)

    return file_fault(name, ".config/lupin/fastdds_super_client.xml", change, expected, "profile", ends_graph=True)


def script_fault(name: str, inject: str, undo: str, expected: str, group: str, **more: Any) -> Case:
    """A fault that one script of root on the robot causes and another undoes."""
    return Case(name, frozenset({expected}), lambda rig: rig.root(inject), lambda rig: rig.root(undo), group, **more)


def node_fault(name: str, expected: str, **variables: str | None) -> Case:
    """A node on the laptop with environment variables that do not fit the robot's graph (None unsets one)."""

    def inject(rig: Rig) -> None:
        env = {**rig.sourced_env, **{key: value for key, value in variables.items() if value is not None}}
        rig.start_participant(
            "talker", env={key: value for key, value in env.items() if variables.get(key, "") is not None}, name=name
        )

    return Case(name, frozenset({expected}), inject, lambda rig: rig.end_participant(name), name, on_robot=False)


def _start_stale_daemon(rig: Rig) -> None:
    env = {**rig.sourced_env, "ROS_DISCOVERY_SERVER": f"{OTHER_ADDRESS}:11811"}
    rig.start_participant("talker", env=env, name="stale-daemon", called="ros2cli.daemon")


def _start_root_node(rig: Rig) -> None:
    profile = "/home/mirte/mirte_ws/install/super_client.xml"
    variables = {"ROS_DISCOVERY_SERVER": "127.0.0.1", "FASTRTPS_DEFAULT_PROFILES_FILE": profile}
    settings = [f"--setenv={name}={value}" for name, value in variables.items()]
    where = [f"--unit={ROOT_NODE_UNIT}", "--uid=root", f"--working-directory={PROJECT}", *settings]
    done = rig.host.robot.inside("systemd-run", "--quiet", "--collect", *where, *PARTICIPANT, "talker")
    if done.status != 0:
        raise RigError(f"root's node: {done.stderr[-300:]}")
    rig.root(
        f"id=$(systemctl show -p InvocationID --value {ROOT_NODE_UNIT})\n"  # ignore the journal of earlier runs
        'said() { journalctl -q -o cat "_SYSTEMD_INVOCATION_ID=$id"; }\n'
        "for _ in $(seq 300); do said | grep -qx up && exit; sleep 0.1; done; exit 1"
    )


def port_fault(name: str, code: str, expected: str, port: int) -> Case:
    """A program on the laptop that holds a port of Lupin."""

    def inject(rig: Rig) -> None:
        process = rig.host.popen([sys.executable, "-c", code], rig.bare_env, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None and process.stdout.readline() == "up\n"
        rig.participants[name] = process

    return Case(name, frozenset({expected}), inject, lambda rig: rig.end_participant(name), f"port {port}", on_robot=False)


def _lose_controllers(state: str) -> Action:
    # Auto-home would repair the controllers, so it is stopped first.
    def inject(rig: Rig) -> None:
        rig.root("u=lupin-auto-home; systemctl stop $u; systemctl disable -q $u; systemctl reset-failed $u || true")
        rig.host.robot.inject_fault("controllers-stuck", state=state)
        rig.root("systemctl enable -q lupin-auto-home")

    return inject


def _restore_controllers(rig: Rig) -> None:
    rig.host.robot.undo_fault("controllers-stuck")


def _stop_serving_time(rig: Rig) -> None:
    rig.host.robot.inject_fault("chrony-not-serving")
    rig.root("systemctl restart chrony")  # chrony counts a source that answered once as reachable


def _serve_time(rig: Rig) -> None:
    rig.host.robot.undo_fault("chrony-not-serving")
    rig.root("systemctl restart chrony")


def _reach_start_limit(rig: Rig) -> None:
    # The cause of the failures is removed; the start limit remains reached.
    rig.host.robot.inject_fault("unit", state="failing")
    rig.root("rm -rf /run/systemd/system/lupin-onboard.service.d; systemctl daemon-reload")


def _undo_start_limit(rig: Rig) -> None:
    rig.host.robot.undo_fault("unit", state="failing")


def _let_logind_remove_memory(rig: Rig) -> None:
    from lupin_sim.host.checkout import LET_LOGIND_REMOVE_SHM

    rig.root(LET_LOGIND_REMOVE_SHM)


def _end_a_login(rig: Rig) -> None:
    # The real cause: a login that ends.
    _let_logind_remove_memory(rig)
    rig.doctor("--only", "link.*")
    rig.root("for _ in $(seq 300); do ls /dev/shm/fastrtps_* >/dev/null 2>&1 || exit 0; sleep 0.1; done; exit 1")


def _restore_memory(rig: Rig) -> None:
    from lupin_sim.host.checkout import keep_shared_memory

    keep_shared_memory(rig.host.robot)
    # Across many faults, the stack restarts more often than the start limits of its units allow.
    rig.root("systemctl reset-failed 'lupin-*'; systemctl restart mirte-ros", 90.0)


def _release_page_stop(rig: Rig) -> None:
    # The stop of a page that disappeared stays engaged until the onboard unit is restarted.
    rig.end_participant("stop")
    rig.root("systemctl restart lupin-onboard", 90.0)


def _append_workspace(text: str) -> str:
    return text + "source ~/mirte_ws/install/setup.bash\n"


def _install_workspace(rig: Rig) -> None:
    install = rig.home / "mirte_ws" / "install"
    rig.write(install / "share" / "mirte_bringup" / "environment" / "fastdds.sh", UNSETTING_HOOK)
    rig.write(install / "setup.bash", ". ~/mirte_ws/install/share/mirte_bringup/environment/fastdds.sh\n")
    bashrc = rig.home / ".bashrc"
    rig.write(bashrc, _append_workspace(bashrc.read_text()))


def _remove_setup(rig: Rig) -> None:
    for name in ("ros-env.sh", "fastdds_super_client.xml"):
        rig.write(rig.config_dir / name, None)
    rig.write(rig.home / ".bashrc", "# a shell\n")


TCP = "import socket, time; s = socket.create_server(('0.0.0.0', {port})); print('up', flush=True); time.sleep(1e6)"
UDP_PREFIX = 'prefix="44.53.00.5f.45.50.52.4f.53.49.4d.41"'
CLOCK_STEP_S = 300.0
ROOT_NODE_UNIT = "lupin-triage-talker"

CASES: tuple[Case, ...] = (
    # -- link
    host_fault("cable-cut", "cable-cut", "no-carrier", "link", unreachable=True, ends_graph=True),
    host_fault("switch-dead", "switch-dead", "robot-unreachable", "link", unreachable=True, ends_graph=True),
    host_fault("sshd-hung", "sshd-hung", "robot-unreachable", "link", unreachable=True),
    host_fault("sshd-down", "sshd-down", "robot-unreachable", "link", unreachable=True),
    host_fault("host-key-changed", "host-key-changed", "robot-unreachable", "link", unreachable=True),
    host_fault("wifi-roam", "wifi-roam", "robot-unreachable", "link", unreachable=True, robot=f"{NAME}-ap"),
    host_fault("dual-homed", "dual-homed", "robot-multi-homed", "link", ends_graph=True, hides=("vendor-stopped",)),
    # -- discovery
    stack_fault("race-port", "server-not-started", "discovery-server-missing", {"cause": "port"}),
    stack_fault("race-path", "server-not-started", "discovery-server-missing", {"cause": "path"}),
    stack_fault("server-killed", "server-killed", "discovery-server-missing"),
    host_fault(
        "server-pinned", "server-pinned", "discovery-server-pinned", "server", ends_graph=True, hides=("profile-address",)
    ),
    host_fault("server-stopped", "server-stopped", "discovery-server-stopped", "server", ends_graph=True),
    host_fault("server-port-taken", "server-port-taken", "discovery-port-taken", "server", ends_graph=True),
    stack_fault("dds-off", "dds-off", "discovery-server-switched-off"),
    # -- processes, shells, profiles
    node_fault("node-bare-shell", "process-multicast-only", ROS_DISCOVERY_SERVER=None, FASTRTPS_DEFAULT_PROFILES_FILE=None),
    node_fault("node-wrong-server", "process-wrong-server", ROS_DISCOVERY_SERVER="10.42.0.7:11811"),
    profile_fault("profile-not-default", 'is_default_profile="true"', 'is_default_profile="false"', "profile-not-default"),
    profile_fault("profile-client", "SUPER_CLIENT", "CLIENT", "profile-not-super-client"),
    profile_fault("profile-prefix", UDP_PREFIX, UDP_PREFIX.replace("44.53.00", "44.53.07"), "profile-wrong-prefix"),
    profile_fault("profile-address", ADDRESS, OTHER_ADDRESS, "profile-wrong-address"),
    Case("shell-bare", frozenset({"shell-multicast-only"}), no_action, group="shell", on_robot=False, shell="plain"),
    Case("shell-rmw", frozenset({"shell-rmw-mismatch"}), no_action, group="shell", on_robot=False, shell="rmw"),
    Case("source-order", frozenset({"source-order"}), _install_workspace, group="shell", on_robot=False, shell="plain"),
    Case(
        "set-up-taken-back",
        frozenset({"dds-not-set-up"}),
        _remove_setup,
        group="shell",
        on_robot=False,
        shell="plain",
        ends_graph=True,
        hides=(*NEED_PROFILE, "stale-daemon"),  # the set-up names the server that a daemon should ask
    ),
    port_fault("page-port-taken", TCP.format(port=8090), "port-8090-taken", 8090),
    port_fault("bridge-port-taken", TCP.format(port=9090), "port-9090-taken", 9090),
    Case(
        "stale-daemon",
        frozenset({"stale-daemon"}),
        _start_stale_daemon,
        lambda rig: rig.end_participant("stale-daemon"),
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
    Case("login-took-memory", frozenset({"shared-memory-removed"}), _end_a_login, _restore_memory, "stale-resources"),
    Case(
        "node-of-root",
        frozenset({"shared-memory-not-shared"}),
        _start_root_node,
        lambda rig: rig.root(f"! systemctl -q is-active {ROOT_NODE_UNIT} || systemctl stop {ROOT_NODE_UNIT}"),
        "stale-resources",
    ),
    # -- units
    host_fault("auto-home-failed", "oneshot-failed", "oneshot-failed", "auto-home"),
    host_fault("onboard-stopped", "unit", "unit-not-running", "onboard", {"state": "stopped"}, hides=NEED_ONBOARD),
    Case(
        "onboard-given-up",
        frozenset({"unit-start-limit"}),
        _reach_start_limit,
        _undo_start_limit,
        "onboard",
        hides=NEED_ONBOARD,
    ),
    host_fault("onboard-disabled", "unit", "unit-not-enabled", "onboard", {"state": "disabled"}),
    host_fault("onboard-masked", "unit", "unit-not-enabled", "onboard", {"state": "masked"}, hides=NEED_ONBOARD),
    script_fault(
        "unit-unread",
        "sleep 1; touch /etc/systemd/system/lupin-onboard.service",
        "systemctl daemon-reload",
        "units-need-reload",
        "onboard",
    ),
    script_fault(
        "vendor-stopped",
        "systemctl stop mirte-ros",
        # The onboard unit may still be masked; undoing that fault starts it.
        "systemctl start mirte-ros; systemctl start lupin-onboard || true; systemctl start --no-block lupin-auto-home",
        "vendor-service-down",
        "server",
        ends_graph=True,
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
        hides=NEED_AUTO_HOME,
    ),
    Case(
        "controllers-unloaded",
        frozenset({"controllers-not-active"}),
        _lose_controllers("unloaded"),
        _restore_controllers,
        "server",
        needs_graph=True,
        hides=NEED_AUTO_HOME,
    ),
    order_fault(
        "controller-inactive",
        "switch deactivate mirte_base_controller",
        "switch activate mirte_base_controller",
        "controllers-not-active",
        "controllers",
    ),
    participant_fault("reader-wants-reliable", "reader", "qos-mismatch"),
    participant_fault("page-zeros", "page", "page-holds-bus", "bus"),
    participant_fault("pad-zeros", "pad", "pad-holds-bus", "bus"),
    Case(
        "page-stop",
        frozenset({"estop-engaged"}),
        lambda rig: rig.start_participant("stop"),
        _release_page_stop,
        "bus",
        needs_graph=True,
    ),
    order_fault("red-button", "press yes", "press no", "estop-engaged", "bus"),
    participant_fault("wrong-sink", "sink", "drive-sink-unheard"),
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
