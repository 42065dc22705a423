"""Every fault of the triage tree that a booted robot and its laptop can have, as a table: how it is made, how it is taken
back, and what the doctor must call it.

The robot is one with the vendor's stack on a simulated robot, Lupin's units, and a clock that it takes from the laptop.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lupin_sim.host import Host
from lupin_sim.host.host import PROJECT

ADDRESS, OTHER_ADDRESS, NAME = "10.42.0.1", "192.168.42.1", "greenhouse"
LUPIN = [sys.executable, "-m", "lupin_cli.app"]
UP_BOUND_S, LEAVE_BOUND_S, HEALTH_BOUND_S, DOCTOR_BOUND_S = 90.0, 60.0, 120.0, 180.0

# What a participant of the graph does on the laptop until it is told to end; `order ...` is done once it was heard.
ACTOR = """
import signal
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})  # before anything starts a thread: one that can die of it would
import dataclasses, math, sys, threading, time
import rclpy
from lupin_runtime import graph
from lupin_runtime.drive.twist import ZERO, encode
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.node import interface

part, *words = sys.argv[1:]
rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
node = LupinNode(f"triage_{part}")

def until(condition):
    deadline = time.monotonic() + 45.0
    while not condition():
        if time.monotonic() > deadline:
            sys.exit(f"{part}: nobody is there")
        rclpy.spin_once(node, timeout_sec=0.05)

def repeat(row, message, period_s=0.05):
    publisher = node.publisher(row)
    node.create_timer(period_s, lambda: publisher.publish(message))

def once(row, message):
    publisher = node.publisher(row)
    until(lambda: publisher.get_subscription_count() > 0)
    for _ in range(20):  # the reader may be matched a moment later than it is counted: seconds later, on a busy machine
        publisher.publish(message)
        time.sleep(0.1)

def call(row, **fields):
    client = node.client(row)
    until(client.service_is_ready)
    future = client.call_async(interface(row.type).Request(**fields))
    until(future.done)
    return future.result()

if part == "page":
    repeat(graph.CMD_VEL_MANUAL, encode(ZERO))
elif part == "pad":
    repeat(graph.CMD_VEL_JOY, encode(ZERO))
elif part == "stop":
    repeat(graph.HMI_ESTOP, interface(graph.HMI_ESTOP.type)(data=True), 0.2)
elif part == "reader":
    node.subscription(graph.SCAN, lambda _: None, qos=graph.REL10)
elif part == "sink":
    repeat(dataclasses.replace(graph.CMD_VEL_SINK_ROBOT, name="/mirte_base_controller/cmd_vel_unstamped"), encode(ZERO))
elif part == "sim":
    once(graph.SIM_FAULT, interface(graph.SIM_FAULT.type)(data=" ".join(words)))
elif part == "battery":
    once(graph.SIM_BATTERY, interface(graph.SIM_BATTERY.type)(data=float(words[0])))
elif part == "press":
    call(graph.SIM_PRESS_ESTOP, data=words[0] == "yes")
elif part == "switch":
    names = {f"{words[0]}_controllers": [words[1]]}
    assert call(graph.SWITCH_CONTROLLER, strictness=2, **names).ok
elif part != "talker":
    sys.exit(f"no part {part}")
print("up", flush=True)
if part in ("sim", "battery", "press", "switch"):
    time.sleep(0.5)  # what was said has to leave before its writer does
else:
    ended = threading.Event()
    def wait():
        signal.sigwait({signal.SIGTERM})
        ended.set()
    threading.Thread(target=wait, daemon=True).start()
    while not ended.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)
node.destroy_node()
rclpy.shutdown()
"""
HOOK = "unset ROS_DISCOVERY_SERVER FASTRTPS_DEFAULT_PROFILES_FILE\n"
RELEASE = "0a1b2c3d4e5f"
START_DOWN = """
for unit in lupin-onboard lupin-auto-home; do
  systemctl is-failed --quiet $unit && systemctl reset-failed $unit
  systemctl is-active --quiet $unit || systemctl start --no-block $unit
done
exit 0
"""


class RigError(RuntimeError):
    """The robot did not do what the measurement needs of it."""


@dataclass
class Rig:
    """A robot that boots, and the laptop of an operator who is set up for it."""

    host: Host
    home: Path
    actors: dict[str, subprocess.Popen[str]] = field(default_factory=dict)
    kept: dict[Path, str | None] = field(default_factory=dict)  # files of the laptop as they were before a fault

    @classmethod
    def start(cls) -> Rig:
        """Boot, deploy, set up. Raises HostError, RigError."""
        rig = cls(Host.start(vendor_robot=True), Path(tempfile.mkdtemp(prefix="lupin-triage-")))
        try:
            rig._set_up()
        except BaseException:
            rig.end()
            raise
        return rig

    def _set_up(self) -> None:
        from lupin_cli import __version__, units
        from lupin_sim.host.checkout import SET_UP, keep_memory

        ssh = self.home / ".ssh"
        ssh.mkdir(mode=0o700)
        shutil.copy(self.host.key, ssh / "id_ed25519")
        (ssh / "id_ed25519").chmod(0o600)
        known = self.host.known_hosts.read_text()
        (ssh / "known_hosts").write_text(known)
        self.own.mkdir(parents=True)
        (self.own / "lupin.toml").write_text(
            f'[robots.{NAME}]\nuser = "mirte"\n[robots.{NAME}.addresses]\nwired = "{ADDRESS}"\n'
            f'[robots.{NAME}-ap]\nuser = "mirte"\n[robots.{NAME}-ap.addresses]\nap = "{OTHER_ADDRESS}"\n'
        )
        (self.home / ".bashrc").write_text("# a shell\n")
        self._lupin("dds", "setup", ADDRESS, "--shell", "bash", env=self.plain)
        version = json.dumps({"version": __version__, "python": list(sys.version_info[:2])})
        self.root(
            f"mkdir -p /opt/lupin/releases/{RELEASE} /opt/lupin/incoming; cd /opt/lupin; ln -sfn releases/{RELEASE} current\n"
            f"ln -sfn {sys.prefix} current/venv; echo '{version}' > current/release.json; usermod -aG input mirte"
        )
        for name, text in units.robot_units("mirte", "/opt/lupin/current", SET_UP).items():
            if name in ("lupin-onboard.service", "lupin-auto-home.service"):
                self.root(f"cat > /etc/systemd/system/{name} <<'UNIT'\n{text}\nUNIT")
        keep_memory(self.host.robot)
        self.host.serve_ntp()
        self._lupin("play", "install-clock-sync", "--robot", NAME, "-v", "laptop_serves=false", "--yes", env=self.sourced)
        self.root("systemctl daemon-reload; systemctl enable -q lupin-onboard lupin-auto-home")
        self.root("systemctl start lupin-clock-sync lupin-onboard; systemctl start --no-block lupin-auto-home", 90.0)

    @property
    def own(self) -> Path:
        """The laptop's folder of settings."""
        return self.home / ".config" / "lupin"

    @property
    def plain(self) -> dict[str, str]:
        """The environment of a shell that sourced nothing."""
        return {"PATH": os.environ["PATH"], "HOME": str(self.home), "SHELL": "/bin/bash"}

    @property
    def shells(self) -> dict[str, dict[str, str]]:
        """The environments in which the doctor is asked, by the names that cases give them."""
        other = {**self.sourced, "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}
        return {"sourced": self.sourced, "plain": self.plain, "rmw": other}

    @property
    def sourced(self) -> dict[str, str]:
        """The environment of a shell that sourced ros-env.sh."""
        return {
            **self.plain,
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(self.own / "fastdds_super_client.xml"),
            "ROS_DISCOVERY_SERVER": f"{ADDRESS}:11811",
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        }

    def _lupin(self, *words: str, env: Mapping[str, str]) -> None:
        done = self.host.run([*LUPIN, *words], env=env, cwd=str(PROJECT), timeout_s=180.0)
        if done.returncode != 0:
            raise RigError(f"lupin {' '.join(words)}: {done.stdout[-300:]} {done.stderr[-500:]}")

    def root(self, script: str, bound_s: float = 60.0) -> str:
        """Run a script on the robot as root. Raises RigError."""
        done = self.host.robot.inside("sh", "-ec", script, timeout_s=bound_s)
        if done.status != 0:
            raise RigError(f"{script[:80]!r} said {done.status}: {done.stderr[-300:]}")
        return str(done.stdout)

    def doctor(self, *words: str, env: Mapping[str, str] | None = None, robot: str = NAME) -> dict[str, Any]:
        """What `lupin doctor --json` says, and how long it took. Raises RigError."""
        began = time.monotonic()
        command = [*LUPIN, "doctor", "--robot", robot, "--json", *words]
        done = self.host.run(command, env=env or self.sourced, cwd=str(PROJECT), timeout_s=DOCTOR_BOUND_S)
        try:
            told: dict[str, Any] = json.loads(done.stdout)
        except ValueError:
            raise RigError(f"the doctor ended with {done.returncode}: {done.stderr[-500:]}") from None
        if done.returncode != told["status"]:
            raise RigError(f"exit status {done.returncode}, and the JSON says {told['status']}")
        return told | {"took_s": round(time.monotonic() - began, 2)}

    def until_healthy(self, env: Mapping[str, str] | None = None, bound_s: float = HEALTH_BOUND_S) -> int:
        """Ask until nothing is found; how often that took. Raises RigError with what is still found."""
        deadline, asked = time.monotonic() + bound_s, 0
        while True:
            told, asked = self.doctor(env=env), asked + 1
            if told["status"] == 0:
                return asked
            if time.monotonic() > deadline:
                lines = [f"{f['id']}: {f['cause']} {f['evidence']}" for f in told["findings"]]
                raise RigError(f"not healthy after {bound_s:g} s: {'; '.join(lines)} {told['unknown']} {told['broken']}")

    def act(self, part: str, *words: str, env: Mapping[str, str] | None = None, name: str = "", called: str = "") -> None:
        """Start a participant on the laptop, `called` so besides, or give an order through one. Raises RigError."""
        command = [sys.executable, "-c", ACTOR, part, *words, *filter(None, [called])]
        process: subprocess.Popen[str] = self.host.popen(
            command, env or self.sourced, cwd=str(PROJECT), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        timer = threading.Timer(UP_BOUND_S, process.kill)
        timer.start()
        try:
            assert process.stdout is not None
            said = process.stdout.readline().strip()
            if said != "up":
                raise RigError(f"{part} {' '.join(words)}: {process.communicate()[1][-300:]}")
            if words:
                process.communicate()
            else:
                self.actors[name or part] = process
        finally:
            timer.cancel()

    def leave(self, name: str) -> None:
        """End a participant in good order."""
        process = self.actors.pop(name, None)
        if process is None:
            return
        process.terminate()
        try:
            process.communicate(timeout=LEAVE_BOUND_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()

    def write(self, path: Path, text: str | None) -> None:
        """Change a file of the laptop (None removes it); the first version of it is remembered."""
        self.kept.setdefault(path, path.read_text() if path.exists() else None)
        if text is None:
            path.unlink(missing_ok=True)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)

    def restore(self) -> None:
        """Give the laptop its files back, and start of Lupin's units on the robot what a fault's end left down."""
        self.root(START_DOWN, 90.0)
        for path, text in self.kept.items():
            if text is None:
                path.unlink(missing_ok=True)
            else:
                path.write_text(text)
        self.kept.clear()

    def end(self) -> None:
        """Switch everything off."""
        for name in list(self.actors):
            self.leave(name)
        self.host.end()
        shutil.rmtree(self.home, ignore_errors=True)


Act = Callable[[Rig], object]


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

    def fits(self, other: Case) -> bool:
        """Whether both can stand, and be seen, at the same time."""
        if self.area and self.area == other.area:
            return False
        if (self.ends_graph and other.needs_graph) or (other.ends_graph and self.needs_graph):
            return False
        if (self.unreachable and other.on_robot) or (other.unreachable and self.on_robot):
            return False
        return {self.shell, other.shell} <= {"sourced", self.shell} and self.robot == other.robot


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
    rig.root(f"for _ in $(seq 300); do journalctl -q -o cat -u {ROOTS_NODE} | grep -qx up && exit; sleep 0.1; done; exit 1")


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
        rig.root("systemctl stop lupin-auto-home; systemctl disable -q lupin-auto-home; systemctl reset-failed; true")
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
    rig.root("systemctl restart mirte-ros", 90.0)


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
    of_host("dual-homed", "dual-homed", "robot-multi-homed", "way", ends_graph=True),
    # -- the phone book
    of_stack("race-port", "server-not-started", "discovery-server-missing", {"cause": "port"}),
    of_stack("race-path", "server-not-started", "discovery-server-missing", {"cause": "path"}),
    of_stack("server-killed", "server-killed", "discovery-server-missing"),
    of_host("server-pinned", "server-pinned", "discovery-server-pinned", "server", ends_graph=True),
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
        *(lambda rig: rig.root(f"systemctl stop {ROOTS_NODE}"), "leftovers"),
    ),
    # -- units
    of_host("auto-home-failed", "oneshot-failed", "oneshot-failed", "auto-home"),
    of_host("onboard-stopped", "unit", "unit-not-running", "onboard", {"state": "stopped"}),
    Case("onboard-given-up", frozenset({"unit-start-limit"}), _give_up, _start_again, "onboard"),
    of_host("onboard-disabled", "unit", "unit-not-enabled", "onboard", {"state": "disabled"}),
    of_host("onboard-masked", "unit", "unit-not-enabled", "onboard", {"state": "masked"}),
    on_robot(
        *("unit-unread", "sleep 1; touch /etc/systemd/system/lupin-onboard.service", "systemctl daemon-reload"),
        *("units-need-reload", "onboard"),
    ),
    on_robot(
        "vendor-stopped",
        "systemctl stop mirte-ros",
        "systemctl start mirte-ros lupin-onboard; systemctl start --no-block lupin-auto-home",
        "vendor-service-down",
        "server",
        ends_graph=True,
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
    ),
    Case(
        *("controllers-unloaded", frozenset({"controllers-not-active"}), _lost_controllers("unloaded")),
        *(_mend_controllers, "server"),
        needs_graph=True,
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
