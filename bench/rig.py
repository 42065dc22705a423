"""What faults are made on: a booted robot with the vendor's stack, Lupin's units and a clock that it takes from the laptop; and
the laptop across the cable, of an operator who is set up for it and asks the doctor."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
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
elif part == "mistyped":
    node.subscription(dataclasses.replace(graph.SCAN, type=graph.BATTERY.type), lambda _: None)
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
RELEASE = "0a1b2c3d4e5f"
START_DOWN = """
for unit in lupin-onboard lupin-auto-home; do
  systemctl is-failed --quiet $unit && systemctl reset-failed $unit
  systemctl is-active --quiet $unit || systemctl start --no-block $unit
done
exit 0
"""
# At work it would heal what the next fault breaks.
AUTO_HOME_ENDS = """
for second in $(seq 120); do
  systemctl show -P ActiveState lupin-auto-home | grep -q activating || exit 0
  sleep 1
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
            # Fast DDS says there what it can't read of a profile, before it goes on without one.
            if all(line.strip() != "up" for line in process.stdout):
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
        """Give the laptop its files back, start what a fault's end left down of Lupin's units, and let auto-home end."""
        self.root(START_DOWN, 90.0)
        self.root(AUTO_HOME_ENDS, 150.0)
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
