"""Every fault of the triage tree that a booted robot and its laptop can have, as a table: how it is made, how it is taken
back, and what the doctor must call it.

The robot is one with the vendor's stack on a simulated robot, Lupin's units, and a clock that it takes from the laptop.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from bench.rig import ACTOR, ADDRESS, NAME, OTHER_ADDRESS, RELEASE, START_DOWN, Rig, RigError
from lupin_sim.host.host import PROJECT

HOOK = "unset ROS_DISCOVERY_SERVER FASTRTPS_DEFAULT_PROFILES_FILE\n"
Act = Callable[[Rig], object]


# What Lupin's own half of the stack says of the drive bus: nobody says it while that half is down.
OF_ONBOARD = ("page-zeros", "pad-zeros", "page-stop", "red-button", "wrong-sink")
# Auto-home is stopped and disabled while controllers are lost: systemd forgets that it failed, and reads all units anew.
OF_AUTO_HOME = ("controller-inactive", "auto-home-failed", "unit-unread")
OF_PROFILE = ("profile-not-default", "profile-client", "profile-prefix", "profile-address")


def nothing(_: Rig) -> None:
    """Taken back by `restore`, or by what takes the other faults back."""


@dataclass(frozen=True)
class Case:
    """A fault and its name. In pairs, cases of one `area` exclude each other."""

    name: str
    expected: frozenset[str]
    make: Act
    mend: Act = nothing
    area: str = ""
    ends_graph: bool = False  # the visitor sees nothing of the robot while it stands
    needs_graph: bool = False
    unreachable: bool = False  # nothing on the robot can be asked
    on_robot: bool = True  # it is seen by asking the robot
    shell: str = "sourced"  # the environment in which the doctor is asked
    robot: str = NAME  # by which name of the inventory
    hides: tuple[str, ...] = ()  # cases whose evidence is gone while this one stands

    def fits(self, other: Case) -> bool:
        """Whether both can stand, and be seen, at the same time."""
        if (self.area and self.area == other.area) or self.name in other.hides or other.name in self.hides:
            return False
        if (self.ends_graph and other.needs_graph) or (other.ends_graph and self.needs_graph):
            return False
        if (self.unreachable and other.on_robot) or (other.unreachable and self.on_robot):
            return False
        return len({self.shell, other.shell} - {"sourced"}) <= 1 and self.robot == other.robot


def of_host(
    name: str, fault: str, expected: str, area: str = "", settings: Mapping[str, Any] | None = None, **more: Any
) -> Case:
    """A fault of `lupin sim host fault`."""
    chosen = dict(settings or {})
    return Case(
        name,
        frozenset({expected}),
        lambda rig: rig.host.robot.fault(fault, **chosen),
        lambda rig: rig.host.robot.mend(fault, **chosen),
        area,
        **more,
    )


def of_stack(name: str, fault: str, expected: str, settings: Mapping[str, Any] | None = None) -> Case:
    """A fault with which the vendor's stack is started anew: as after a boot, Lupin's half starts beside it."""
    chosen = dict(settings or {})

    def make(rig: Rig) -> None:
        rig.host.robot.fault(fault, **chosen)
        rig.root(START_DOWN, 90.0)

    return Case(
        name, frozenset({expected}), make, of_host(name, fault, expected, settings=chosen).mend, "server", ends_graph=True
    )


def on_graph(name: str, part: str, expected: str, area: str = "") -> Case:
    """A participant of the graph on the laptop."""
    return Case(
        name, frozenset({expected}), lambda rig: rig.act(part), lambda rig: rig.leave(part), area or part, needs_graph=True
    )


def order(name: str, make: str, mend: str, expected: str, area: str) -> Case:
    """An order to the simulated robot, and the one that takes it back."""
    return Case(
        name,
        frozenset({expected}),
        lambda rig: rig.act(*make.split()),
        lambda rig: rig.act(*mend.split()),
        area,
        needs_graph=True,
    )


def of_file(name: str, path: str, change: Callable[[str], str | None], expected: str, area: str, **more: Any) -> Case:
    """A file in the operator's home that is other than it should be."""

    def make(rig: Rig) -> None:
        place = rig.home / path
        rig.write(place, change(place.read_text() if place.exists() else ""))

    return Case(name, frozenset({expected}), make, area=area, on_robot=False, **more)


def of_profile(name: str, old: str, new: str, expected: str) -> Case:
    """A fault of the super client's profile."""

    def change(text: str) -> str:
        if old not in text:
            raise RigError(f"the profile holds no {old!r}")
        return text.replace(old, new)

    return of_file(name, ".config/lupin/fastdds_super_client.xml", change, expected, "profile", ends_graph=True)


def on_robot(name: str, make: str, mend: str, expected: str, area: str, **more: Any) -> Case:
    """A script that root runs on the robot, and the one that takes it back."""
    return Case(name, frozenset({expected}), lambda rig: rig.root(make), lambda rig: rig.root(mend), area, **more)


def node_of(name: str, expected: str, **variables: str | None) -> Case:
    """A node on the laptop whose environment is another than the robot's graph asks for."""

    def make(rig: Rig) -> None:
        env = {**rig.sourced, **{key: value for key, value in variables.items() if value is not None}}
        rig.act("talker", env={key: value for key, value in env.items() if variables.get(key, "") is not None}, name=name)

    return Case(name, frozenset({expected}), make, lambda rig: rig.leave(name), name, on_robot=False)


def _old_daemon(rig: Rig) -> None:
    env = {**rig.sourced, "ROS_DISCOVERY_SERVER": f"{OTHER_ADDRESS}:11811"}
    rig.act("talker", env=env, name="stale-daemon", called="ros2cli.daemon")


def _node_of_root(rig: Rig) -> None:
    profile = "/home/mirte/mirte_ws/install/super_client.xml"
    variables = {"ROS_DISCOVERY_SERVER": "127.0.0.1", "FASTRTPS_DEFAULT_PROFILES_FILE": profile}
    settings = [f"--setenv={name}={value}" for name, value in variables.items()]
    where = [f"--unit={ROOTS_NODE}", "--uid=root", f"--working-directory={PROJECT}", *settings]
    done = rig.host.robot.inside("systemd-run", "--quiet", "--collect", *where, sys.executable, "-c", ACTOR, "talker")
    if done.status != 0:
        raise RigError(f"root's node: {done.stderr[-300:]}")
    rig.root(
        f"id=$(systemctl show -p InvocationID --value {ROOTS_NODE})\n"  # an earlier one's word doesn't count
        'said() { journalctl -q -o cat "_SYSTEMD_INVOCATION_ID=$id"; }\n'
        "for _ in $(seq 300); do said | grep -qx up && exit; sleep 0.1; done; exit 1"
    )


def stranger(name: str, code: str, expected: str, port: int) -> Case:
    """A program on the laptop that holds a port."""

    def make(rig: Rig) -> None:
        process = rig.host.popen([sys.executable, "-c", code], rig.plain, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None and process.stdout.readline() == "up\n"
        rig.actors[name] = process

    return Case(name, frozenset({expected}), make, lambda rig: rig.leave(name), f"port {port}", on_robot=False)


def _lost_controllers(state: str) -> Act:
    # Auto-home belongs to the stack and would heal them: it has given up here.
    def make(rig: Rig) -> None:
        rig.root("u=lupin-auto-home; systemctl stop $u; systemctl disable -q $u; systemctl reset-failed $u || true")
        rig.host.robot.fault("controllers-stuck", state=state)
        rig.root("systemctl enable -q lupin-auto-home")

    return make


def _mend_controllers(rig: Rig) -> None:
    rig.host.robot.mend("controllers-stuck")


def _not_serving(rig: Rig) -> None:
    rig.host.robot.fault("chrony-not-serving")
    rig.root("systemctl restart chrony")  # a source that answered once counts as one that answers


def _serving(rig: Rig) -> None:
    rig.host.robot.mend("chrony-not-serving")
    rig.root("systemctl restart chrony")


def _give_up(rig: Rig) -> None:
    # Why it failed is over; that systemd has given it up is not.
    rig.host.robot.fault("unit", state="failing")
    rig.root("rm -rf /run/systemd/system/lupin-onboard.service.d; systemctl daemon-reload")


def _start_again(rig: Rig) -> None:
    rig.host.robot.mend("unit", state="failing")


def _lose_memory(rig: Rig) -> None:
    from lupin_sim.host.checkout import LOSE_MEMORY

    rig.root(LOSE_MEMORY)


def _take_memory(rig: Rig) -> None:
    # By the real thing: somebody logs in, and out.
    _lose_memory(rig)
    rig.doctor("--only", "link.*")
    rig.root("for _ in $(seq 300); do ls /dev/shm/fastrtps_* >/dev/null 2>&1 || exit 0; sleep 0.1; done; exit 1")


def _memory_again(rig: Rig) -> None:
    from lupin_sim.host.checkout import keep_memory

    keep_memory(rig.host.robot)
    # Fault after fault, the stack is restarted more often than its units' limits of starts allow for.
    rig.root("systemctl reset-failed 'lupin-*'; systemctl restart mirte-ros", 90.0)


def _page_gone(rig: Rig) -> None:
    # A page that held the stop and is gone holds it still: whoever stands beside the robot starts its half anew.
    rig.leave("stop")
    rig.root("systemctl restart lupin-onboard", 90.0)


def _wrong_order(text: str) -> str:
    return text + "source ~/mirte_ws/install/setup.bash\n"


def _workspace(rig: Rig) -> None:
    install = rig.home / "mirte_ws" / "install"
    rig.write(install / "share" / "mirte_bringup" / "environment" / "fastdds.sh", HOOK)
    rig.write(install / "setup.bash", ". ~/mirte_ws/install/share/mirte_bringup/environment/fastdds.sh\n")
    bashrc = rig.home / ".bashrc"
    rig.write(bashrc, _wrong_order(bashrc.read_text()))


def _set_up_taken_back(rig: Rig) -> None:
    for name in ("ros-env.sh", "fastdds_super_client.xml"):
        rig.write(rig.own / name, None)
    rig.write(rig.home / ".bashrc", "# a shell\n")


TCP = "import socket, time; s = socket.create_server(('0.0.0.0', {port})); print('up', flush=True); time.sleep(1e6)"
UDP_PREFIX = 'prefix="44.53.00.5f.45.50.52.4f.53.49.4d.41"'
CLOCK_STEP_S = 300.0
ROOTS_NODE = "lupin-triage-talker"

CASES: tuple[Case, ...] = (
    # -- the way there
    of_host("cable-cut", "cable-cut", "no-carrier", "way", unreachable=True, ends_graph=True),
    of_host("switch-dead", "switch-dead", "robot-unreachable", "way", unreachable=True, ends_graph=True),
    of_host("sshd-hung", "sshd-hung", "robot-unreachable", "way", unreachable=True),
    of_host("sshd-down", "sshd-down", "robot-unreachable", "way", unreachable=True),
    of_host("host-key-changed", "host-key-changed", "robot-unreachable", "way", unreachable=True),
    of_host("wifi-roam", "wifi-roam", "robot-unreachable", "way", unreachable=True, robot=f"{NAME}-ap"),
    of_host("dual-homed", "dual-homed", "robot-multi-homed", "way", ends_graph=True, hides=("vendor-stopped",)),
    # -- the phone book
    of_stack("race-port", "server-not-started", "discovery-server-missing", {"cause": "port"}),
    of_stack("race-path", "server-not-started", "discovery-server-missing", {"cause": "path"}),
    of_stack("server-killed", "server-killed", "discovery-server-missing"),
    of_host(
        *("server-pinned", "server-pinned", "discovery-server-pinned", "server"), ends_graph=True, hides=("profile-address",)
    ),
    of_host("server-stopped", "server-stopped", "discovery-server-stopped", "server", ends_graph=True),
    of_host("server-port-taken", "server-port-taken", "discovery-port-taken", "server", ends_graph=True),
    of_stack("dds-off", "dds-off", "discovery-server-switched-off"),
    # -- processes, shells, profiles
    node_of("node-bare-shell", "process-multicast-only", ROS_DISCOVERY_SERVER=None, FASTRTPS_DEFAULT_PROFILES_FILE=None),
    node_of("node-wrong-server", "process-wrong-server", ROS_DISCOVERY_SERVER="10.42.0.7:11811"),
    of_profile("profile-not-default", 'is_default_profile="true"', 'is_default_profile="false"', "profile-not-default"),
    of_profile("profile-client", "SUPER_CLIENT", "CLIENT", "profile-not-super-client"),
    of_profile("profile-prefix", UDP_PREFIX, UDP_PREFIX.replace("44.53.00", "44.53.07"), "profile-wrong-prefix"),
    of_profile("profile-address", ADDRESS, OTHER_ADDRESS, "profile-wrong-address"),
    Case("shell-bare", frozenset({"shell-multicast-only"}), nothing, area="shell", on_robot=False, shell="plain"),
    Case("shell-rmw", frozenset({"shell-rmw-mismatch"}), nothing, area="shell", on_robot=False, shell="rmw"),
    Case("source-order", frozenset({"source-order"}), _workspace, area="shell", on_robot=False, shell="plain"),
    Case(
        *("set-up-taken-back", frozenset({"dds-not-set-up"}), _set_up_taken_back),
        area="shell",
        on_robot=False,
        shell="plain",
        ends_graph=True,
        hides=(*OF_PROFILE, "stale-daemon"),  # what a daemon should ask is told by the set-up
    ),
    stranger("page-port-taken", TCP.format(port=8090), "port-8090-taken", 8090),
    stranger("bridge-port-taken", TCP.format(port=9090), "port-9090-taken", 9090),
    Case("stale-daemon", frozenset({"stale-daemon"}), _old_daemon, lambda rig: rig.leave("stale-daemon"), on_robot=False),
    # -- leftovers
    of_host("zombies", "zombies", "zombie-process", "leftovers"),
    of_host("shm-orphans", "shm-orphans", "shared-memory-orphans", "leftovers"),
    of_host("shm-full", "shm-full", "shared-memory-full", "leftovers"),
    Case("login-may-take-memory", frozenset({"shared-memory-at-risk"}), _lose_memory, _memory_again, "leftovers"),
    Case("login-took-memory", frozenset({"shared-memory-removed"}), _take_memory, _memory_again, "leftovers"),
    Case(
        *("node-of-root", frozenset({"shared-memory-not-shared"}), _node_of_root),
        *(lambda rig: rig.root(f"! systemctl -q is-active {ROOTS_NODE} || systemctl stop {ROOTS_NODE}"), "leftovers"),
    ),
    # -- units
    of_host("auto-home-failed", "oneshot-failed", "oneshot-failed", "auto-home"),
    of_host("onboard-stopped", "unit", "unit-not-running", "onboard", {"state": "stopped"}, hides=OF_ONBOARD),
    Case("onboard-given-up", frozenset({"unit-start-limit"}), _give_up, _start_again, "onboard", hides=OF_ONBOARD),
    of_host("onboard-disabled", "unit", "unit-not-enabled", "onboard", {"state": "disabled"}),
    of_host("onboard-masked", "unit", "unit-not-enabled", "onboard", {"state": "masked"}, hides=OF_ONBOARD),
    on_robot(
        *("unit-unread", "sleep 1; touch /etc/systemd/system/lupin-onboard.service", "systemctl daemon-reload"),
        *("units-need-reload", "onboard"),
    ),
    on_robot(
        "vendor-stopped",
        "systemctl stop mirte-ros",
        # Lupin's half may be masked still: who takes that back starts it.
        "systemctl start mirte-ros; systemctl start lupin-onboard || true; systemctl start --no-block lupin-auto-home",
        "vendor-service-down",
        "server",
        ends_graph=True,
        # Nobody's camera is taken, nobody's memory is or was, and root shares his with nobody.
        hides=("camera-held", "login-may-take-memory", "login-took-memory", "node-of-root"),
    ),
    # -- clocks
    of_host("clock-wrong", "clock-wrong", "clock-drift", "clock", {"offset_s": CLOCK_STEP_S}),
    of_host("chrony-stopped", "chrony-stopped", "chrony-not-running", "clock"),
    Case("laptop-not-serving", frozenset({"chrony-not-serving"}), _not_serving, _serving, "clock"),
    of_host("stock-makestep", "stock-makestep", "chrony-stock-makestep", "makestep"),
    # -- the graph
    Case(
        *("controllers-unconfigured", frozenset({"controllers-not-active"}), _lost_controllers("unconfigured")),
        *(_mend_controllers, "server"),
        needs_graph=True,
        hides=OF_AUTO_HOME,
    ),
    Case(
        *("controllers-unloaded", frozenset({"controllers-not-active"}), _lost_controllers("unloaded")),
        *(_mend_controllers, "server"),
        needs_graph=True,
        hides=OF_AUTO_HOME,
    ),
    order(
        "controller-inactive",
        "switch deactivate mirte_base_controller",
        "switch activate mirte_base_controller",
        "controllers-not-active",
        "controllers",
    ),
    on_graph("reader-wants-reliable", "reader", "qos-mismatch"),
    on_graph("page-zeros", "page", "page-holds-bus", "bus"),
    on_graph("pad-zeros", "pad", "pad-holds-bus", "bus"),
    Case("page-stop", frozenset({"estop-engaged"}), lambda rig: rig.act("stop"), _page_gone, "bus", needs_graph=True),
    order("red-button", "press yes", "press no", "estop-engaged", "bus"),
    on_graph("wrong-sink", "sink", "drive-sink-unheard"),
    order("lidar-silent", "sim scan silent", "sim scan none", "topic-silent", "lidar"),
    order("board-silent", "sim board silent", "sim board none", "board-wedged", "board"),
    order("battery-low", "battery 0.1", "battery 0.85", "battery-low", "board"),
    order("battery-nan", "sim battery nan", "sim battery none", "battery-unreadable", "board"),
    # -- the computer
    of_host("disk-full", "disk-full", "disk-full", "disk"),
    of_host("disk-read-only", "disk-read-only", "filesystem-read-only", "disk"),
    of_host("camera-held", "camera-held", "camera-held", "camera"),
    of_host("not-in-group", "not-in-group", "groups-missing", "account"),
    of_host("home-locked", "home-locked", "home-not-writable", "account"),
    of_host("no-python", "program-missing", "python-missing", "software", {"program": "python3"}),
    on_robot(
        *("release-gone", f"mv /opt/lupin/releases/{RELEASE} /opt/lupin/releases/away"),
        *(f"mv /opt/lupin/releases/away /opt/lupin/releases/{RELEASE}", "release-broken", "software"),
    ),
    on_robot(
        *(
            "older-release",
            'cd /opt/lupin/current; cp release.json keep; sed -i \'s/"version": "[^"]*"/"version": "0.0.1"/\' release.json',
        ),
        *("cd /opt/lupin/current; mv keep release.json", "version-skew", "software"),
    ),
)
