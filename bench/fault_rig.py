"""The two machines into which the triage benchmark injects faults, connected by a cable.

The robot is a simulated computer. It runs the vendor's stack, which drives a simulated robot, and Lupin's units; its clock
follows the laptop's. The laptop is configured for the robot and runs the doctor.
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
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lupin_cli.exit_codes import SUCCESS
from lupin_runtime.ports import DISCOVERY_PORT
from lupin_sim.host import Host
from lupin_sim.host.host import PROJECT
from tests.support.onboard_units import install_units

WIRED_ADDRESS, AP_ADDRESS = "10.42.0.1", "192.168.42.1"
ROBOT = "greenhouse"  # in the inventory, with the wired address; {ROBOT}-ap is the same robot over its access point
LUPIN = [sys.executable, "-m", "lupin_cli.app"]
PARTICIPANT_START_TIMEOUT_S, PROCESS_STOP_TIMEOUT_S, HEALTHY_TIMEOUT_S, DOCTOR_TIMEOUT_S = 90.0, 60.0, 120.0, 180.0

# The command that starts a participant of the graph; its role and arguments follow.
PARTICIPANT = [sys.executable, "-m", "tests.support.graph_participant"]
ORIGINAL_BASHRC = "# the operator's settings\n"  # before `lupin dds setup` appends its line
RELEASE = "0a1b2c3d4e5f"  # an invented id; the release consists of a link to this Python and a release.json
START_STOPPED_UNITS = """
for unit in lupin-onboard lupin-auto-home; do
  systemctl is-failed --quiet $unit && systemctl reset-failed $unit
  systemctl is-active --quiet $unit || systemctl start --no-block $unit
done
exit 0
"""
# Auto-home would repair what the next fault breaks, so it must have finished; a unit that still starts is a fault of its own.
WAIT_FOR_UNITS = """
for second in $(seq 120); do
  systemctl show -P ActiveState lupin-auto-home lupin-onboard lupin-cameras | grep -q activating || exit 0
  sleep 1
done
exit 0
"""


class RigError(RuntimeError):
    """A step of the measurement failed on the robot or the laptop."""


@dataclass
class FaultRig:
    """A booted robot, and an operator's laptop that is configured for it."""

    machines: Host  # `machines.robot` is the robot; `machines.run` and `machines.popen` run programs on the laptop
    home: Path  # the operator's, on the laptop
    processes: dict[str, subprocess.Popen[str]] = field(default_factory=dict)  # on the laptop, which are the injected faults
    original_files: dict[Path, str | None] = field(default_factory=dict)  # the laptop's files before a fault; None: no file

    @classmethod
    def start(cls, *, cable_only: bool = False) -> FaultRig:
        """Boot the robot, deploy to it, and configure both machines. Raises HostError, RigError.

        With `cable_only`, the access point is out of range before any participant starts: DDS announces only the cable's
        addresses, so a fault of the cable is felt. Otherwise data also takes the access point.
        """
        rig = cls(Host.start(vendor_robot=True), Path(tempfile.mkdtemp(prefix="lupin-fault-rig-")))
        try:
            if cable_only:
                rig.machines.robot.inject_fault("cable-cut", link="wlan0")
                rig.run_as_root("systemctl restart mirte-ros", 90.0)
            rig._set_up()
        except BaseException:
            rig.stop()
            raise
        return rig

    def _set_up(self) -> None:
        from lupin_cli import __version__

        ssh = self.home / ".ssh"
        ssh.mkdir(mode=0o700)
        shutil.copy(self.machines.key, ssh / "id_ed25519")
        (ssh / "id_ed25519").chmod(0o600)
        known = self.machines.known_hosts.read_text()
        (ssh / "known_hosts").write_text(known)
        self.config_dir.mkdir(parents=True)
        (self.config_dir / "lupin.toml").write_text(
            f'[robots.{ROBOT}]\nuser = "mirte"\n[robots.{ROBOT}.addresses]\nwired = "{WIRED_ADDRESS}"\n'
            f'[robots.{ROBOT}-ap]\nuser = "mirte"\n[robots.{ROBOT}-ap.addresses]\nap = "{AP_ADDRESS}"\n'
        )
        (self.home / ".bashrc").write_text(ORIGINAL_BASHRC)
        self._lupin("dds", "setup", WIRED_ADDRESS, "--shell", "bash", env=self.bare_env)
        version = json.dumps({"version": __version__, "python": list(sys.version_info[:2])})
        self.run_as_root(
            f"mkdir -p /opt/lupin/releases/{RELEASE} /opt/lupin/incoming; cd /opt/lupin; ln -sfn releases/{RELEASE} current\n"
            f"echo '{version}' > current/release.json; usermod -aG input mirte"
        )
        install_units(self.machines.robot, ("lupin-onboard.service", "lupin-auto-home.service"))
        self.machines.serve_ntp()  # so the playbook need not, and must not, configure the chrony of this machine
        self._lupin("play", "install-clock-sync", "--robot", ROBOT, "-v", "laptop_serves=false", "--yes", env=self.sourced_env)
        self.run_as_root("systemctl daemon-reload; systemctl enable -q lupin-onboard lupin-auto-home")
        self.run_as_root("systemctl start lupin-clock-sync lupin-onboard; systemctl start --no-block lupin-auto-home", 90.0)

    @property
    def config_dir(self) -> Path:
        """The folder of Lupin's settings on the laptop."""
        return self.home / ".config" / "lupin"

    @property
    def bare_env(self) -> dict[str, str]:
        """The environment of a shell that has sourced nothing."""
        return {"PATH": os.environ["PATH"], "HOME": str(self.home), "SHELL": "/bin/bash"}

    @property
    def environments(self) -> dict[str, dict[str, str]]:
        """Environments in which the doctor runs, by the names in FaultCase.shell."""
        wrong_rmw_env = {**self.sourced_env, "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}
        return {"sourced": self.sourced_env, "bare": self.bare_env, "wrong-rmw": wrong_rmw_env}

    @property
    def sourced_env(self) -> dict[str, str]:
        """The environment of a shell that has sourced ros-env.sh."""
        return {
            **self.bare_env,
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(self.config_dir / "fastdds_super_client.xml"),
            "ROS_DISCOVERY_SERVER": f"{WIRED_ADDRESS}:{DISCOVERY_PORT}",
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        }

    def _lupin(self, *words: str, env: Mapping[str, str]) -> None:
        done = self.machines.run([*LUPIN, *words], env=env, cwd=str(PROJECT), timeout_s=180.0)
        if done.returncode != 0:
            raise RigError(f"lupin {' '.join(words)}: {done.stdout[-300:]} {done.stderr[-500:]}")

    def run_as_root(self, script: str, timeout_s: float = 60.0) -> str:
        """Run a script on the robot as root. Raises RigError."""
        done = self.machines.robot.run_as_root("sh", "-ec", script, timeout_s=timeout_s)
        if done.status != 0:
            raise RigError(f"{script[:80]!r} exited with {done.status}: {done.stderr[-300:]}")
        return str(done.stdout)

    def run_doctor(self, *words: str, env: Mapping[str, str] | None = None, robot: str = ROBOT) -> dict[str, Any]:
        """Run `lupin doctor`; return its JSON report, with the wall time as `took_s`. Raises RigError."""
        began = time.monotonic()
        command = [*LUPIN, "doctor", "--robot", robot, "--json", *words]
        done = self.machines.run(command, env=env or self.sourced_env, cwd=str(PROJECT), timeout_s=DOCTOR_TIMEOUT_S)
        try:
            report: dict[str, Any] = json.loads(done.stdout)
        except ValueError:
            raise RigError(f"the doctor exited with {done.returncode}: {done.stderr[-500:]}") from None
        if done.returncode != report["status"]:
            raise RigError(f"the doctor exited with {done.returncode}, but its JSON report has the status {report['status']}")
        return report | {"took_s": round(time.monotonic() - began, 2)}

    def wait_until_healthy(self, env: Mapping[str, str] | None = None, timeout_s: float = HEALTHY_TIMEOUT_S) -> int:
        """Run the doctor until it finds nothing, and return how often it ran. Raises RigError with the remaining findings."""
        deadline, runs = time.monotonic() + timeout_s, 0
        while True:
            report, runs = self.run_doctor(env=env), runs + 1
            if report["status"] == SUCCESS:
                return runs
            if time.monotonic() > deadline:
                lines = [f"{f['id']}: {f['cause']} {f['evidence']}" for f in report["findings"]]
                raise RigError(f"not healthy after {timeout_s:g} s: {'; '.join(lines)} {report['unknown']} {report['broken']}")

    def start_participant(
        self, role: str, *arguments: str, env: Mapping[str, str] | None = None, name: str = "", command_line_tag: str = ""
    ) -> None:
        """Start a participant of the graph in this role on the laptop, and wait until it reports that it is up.

        With `arguments`, the participant executes that one command and exits, which is also waited for. `name` (default: the
        role) is the name for `stop_process`. `command_line_tag` is an argument that the participant ignores, but that others
        see in its command line. Raises RigError.
        """
        command = [*PARTICIPANT, role, *arguments, *filter(None, [command_line_tag])]
        process: subprocess.Popen[str] = self.machines.popen(
            command, env or self.sourced_env, cwd=str(PROJECT), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        timer = threading.Timer(PARTICIPANT_START_TIMEOUT_S, process.kill)
        timer.start()
        try:
            assert process.stdout is not None
            # Fast DDS may print errors about an unusable profile before `up`; it continues without the profile.
            if "up" not in (line.strip() for line in process.stdout):
                raise RigError(f"{role} {' '.join(arguments)}: {process.communicate()[1][-300:]}")
            if arguments:
                process.communicate()
            else:
                self.processes[name or role] = process
        finally:
            timer.cancel()

    def stop_process(self, name: str) -> None:
        """Terminate a process on the laptop, if it was started: with SIGTERM, or SIGKILL after PROCESS_STOP_TIMEOUT_S."""
        process = self.processes.pop(name, None)
        if process is None:
            return
        process.terminate()
        try:
            process.communicate(timeout=PROCESS_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()

    def write_file(self, path: Path, text: str | None) -> None:
        """Write a file of the laptop, or remove it if `text` is None. `restore` writes the original back."""
        self.original_files.setdefault(path, path.read_text() if path.exists() else None)
        if text is None:
            path.unlink(missing_ok=True)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)

    def restore(self) -> None:
        """Start those of Lupin's units that are still stopped after the faults were undone, wait until they have started, and
        restore the laptop's files."""
        self.run_as_root(START_STOPPED_UNITS, 90.0)
        self.run_as_root(WAIT_FOR_UNITS, 150.0)
        for path, text in self.original_files.items():
            if text is None:
                path.unlink(missing_ok=True)
            else:
                path.write_text(text)
        self.original_files.clear()

    def stop(self) -> None:
        """Stop all processes on the laptop and both machines, and remove the operator's home."""
        for name in list(self.processes):
            self.stop_process(name)
        self.machines.end()
        shutil.rmtree(self.home, ignore_errors=True)
