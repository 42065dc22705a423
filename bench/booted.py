"""A simulated computer, and an operator on the laptop whose commands are timed from start to exit."""

from __future__ import annotations

import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bench.peers.pyinfra_and_ansible import PeerTools
    from lupin_sim.host import Host

PROJECT_BENCH = Path(__file__).resolve().parent
COMMAND_TIMEOUT_S = 300.0
# Setup lines for the units of this robot, whose only ROS is the vendor's.
SETUP_LINES = ("source ~/mirte_ws/install/setup.bash",)
LUPIN = (sys.executable, "-m", "lupin_cli.app")
PYTHON_PATH = "/usr/bin:/bin:/usr/sbin:/sbin"


@dataclass(frozen=True)
class TimedRun:
    """A command that was run: its duration, exit status (-1 if it timed out) and output."""

    wall_s: float
    status: int
    stdout: str
    stderr: str
    timed_out: bool = False


@dataclass
class Operator:
    """An operator on the laptop, whose inventory has the robot as `mirte`."""

    host: Host
    home: Path
    environment: dict[str, str] = field(default_factory=dict)

    def run(
        self, command: Sequence[str], environment: Mapping[str, str] | None = None, timeout_s: float = COMMAND_TIMEOUT_S
    ) -> TimedRun:
        """Run a command on the laptop, without the environment of this process."""
        from lupin_sim.host.host import PROJECT

        start = time.perf_counter()
        try:
            done = self.host.run(command, timeout_s=timeout_s, env=dict(environment or self.environment), cwd=str(PROJECT))
        except subprocess.TimeoutExpired:
            return TimedRun(time.perf_counter() - start, -1, "", "", timed_out=True)
        return TimedRun(time.perf_counter() - start, done.returncode, done.stdout, done.stderr)

    def lupin(self, *words: str, timeout_s: float = COMMAND_TIMEOUT_S) -> TimedRun:
        """Run `lupin WORDS`."""
        return self.run([*LUPIN, *words], timeout_s=timeout_s)

    def require(self, ran: TimedRun, *statuses: int) -> TimedRun:
        """Return the run if its exit status is one of these (default 0); otherwise stop the benchmark with its output."""
        if ran.status not in (statuses or (0,)):
            raise SystemExit(
                f"not measured: status {ran.status}{' (timed out)' if ran.timed_out else ''}\n{ran.stdout}\n{ran.stderr}"
            )
        return ran


@contextlib.contextmanager
def booted_operator(**options: Any) -> Iterator[Operator]:
    """Boot a host and yield its operator; `options` are those of Host.start. Exits if this machine cannot boot one."""
    from lupin_sim.host import Host
    from lupin_sim.host.operator import create_home
    from lupin_sim.host.prerequisites import missing_prerequisite

    if missing := missing_prerequisite():
        raise SystemExit(f"not measured: {missing}")
    # A short path, because it contains the socket of a shared SSH connection.
    with tempfile.TemporaryDirectory(prefix="lb-", dir="/tmp") as name, Host.start(**options) as host:
        home = Path(name) / "home"
        environment = create_home(host, home, SETUP_LINES)
        # The checkout comes first, as the virtual environment may be another one's.
        fixed = {"PATH": PYTHON_PATH, "LC_ALL": "C.UTF-8", "SHELL": "/bin/bash", "PYTHONPATH": str(PROJECT_BENCH.parent)}
        yield Operator(host, home, {**fixed, **environment})


@contextlib.contextmanager
def peer_tools(operator: Operator) -> Iterator[PeerTools]:
    """Set up pyinfra and Ansible for the same operator, and yield them."""
    from bench.peers.pyinfra_and_ansible import PeerTools, install_tools

    folder = operator.home.parent / "peers"
    folder.mkdir()
    key = folder / "key"
    key.write_bytes(operator.host.key.read_bytes())
    key.chmod(0o600)
    tools = PeerTools(install_tools(), folder, operator.host.robot.eth0, "mirte", key, operator.host.known_hosts)
    null = subprocess.DEVNULL
    opened = operator.host.run(tools.shared_connection_command("open"), stdout=null, stderr=null, env=tools.environment)
    if opened.returncode != 0:
        raise SystemExit(f"not measured: ssh to {tools.address} exited with status {opened.returncode}")
    try:
        yield tools
    finally:
        operator.run(tools.shared_connection_command("exit"), tools.environment, 20.0)


# The processes that a login involves.
DAEMONS = ("systemd", "systemd-logind", "systemd-journal", "dbus-daemon", "sshd")


def raise_priority(host: Host, stack: bool = False) -> None:
    """Give the measured processes on laptop and robot real-time priority over all other work of this machine.

    Nice values have no such effect if the kernel groups processes by session. The simulated robot and Lupin's units on the
    robot keep their priority, unless they are part of the measurement (`stack`).
    """
    from lupin_sim.host.prerequisites import cgroup_roots

    os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    for root in cgroup_roots():
        for path in (root / f"lupin-host-{host.name}").rglob("cgroup.procs"):
            for pid in path.read_text().split():
                with contextlib.suppress(OSError):  # the process has exited meanwhile
                    if stack or Path(f"/proc/{pid}/comm").read_text().strip() in DAEMONS:
                        for task in Path(f"/proc/{pid}/task").iterdir():
                            os.sched_setscheduler(int(task.name), os.SCHED_RR, os.sched_param(1))


def median(values: Sequence[float]) -> float:
    """Return the median, rounded to three decimals."""
    return round(statistics.median(values), 3)


def load_average() -> float:
    """Return the load average of the last minute."""
    return round(os.getloadavg()[0], 1)
