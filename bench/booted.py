"""A robot's computer that boots, and an operator's shell on the laptop beside it: whole commands, timed from start to end."""

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
    from bench.peers.tools import Tools
    from lupin_sim.host import Host

PROJECT_BENCH = Path(__file__).resolve().parent
COMMAND_BOUND_S = 300.0
# As `lupin deploy robot` gives it to the units; the booted robot has no ROS beside the vendor's.
SET_UP = ("source ~/mirte_ws/install/setup.bash",)
LUPIN = (sys.executable, "-m", "lupin_cli.app")
PYTHON_PATH = "/usr/bin:/bin:/usr/sbin:/sbin"


@dataclass(frozen=True)
class Ran:
    """A command that was run: seconds from its start to its end, and what it left. `cut` where the bound ended it."""

    wall_s: float
    status: int
    stdout: str
    stderr: str
    cut: bool = False


@dataclass
class Operator:
    """Somebody at the laptop, whose inventory knows the robot as `mirte`."""

    host: Host
    home: Path
    environment: dict[str, str] = field(default_factory=dict)

    def run(
        self, command: Sequence[str], environment: Mapping[str, str] | None = None, bound_s: float = COMMAND_BOUND_S
    ) -> Ran:
        """Run a command on the laptop, with nothing of this machine's environment."""
        from lupin_sim.host.host import PROJECT

        began = time.perf_counter()
        try:
            done = self.host.run(command, timeout_s=bound_s, env=dict(environment or self.environment), cwd=str(PROJECT))
        except subprocess.TimeoutExpired:
            return Ran(time.perf_counter() - began, -1, "", "", cut=True)
        return Ran(time.perf_counter() - began, done.returncode, done.stdout, done.stderr)

    def lupin(self, *words: str, bound_s: float = COMMAND_BOUND_S) -> Ran:
        """`lupin WORDS`, as typed."""
        return self.run([*LUPIN, *words], bound_s=bound_s)

    def must(self, ran: Ran, *statuses: int) -> Ran:
        """What ran, where it ended as it should; else the bench ends with its words."""
        if ran.status not in (statuses or (0,)):
            raise SystemExit(f"not measured: status {ran.status}{' (cut)' if ran.cut else ''}\n{ran.stdout}\n{ran.stderr}")
        return ran


@contextlib.contextmanager
def operator(**options: Any) -> Iterator[Operator]:
    """A host (see Host.start for `options`) and its operator. Ends the program where this machine can't boot one."""
    from lupin_sim.host import Host
    from lupin_sim.host.missing import what_is_missing
    from lupin_sim.host.operator import furnish

    if missing := what_is_missing():
        raise SystemExit(f"not measured: {missing}")
    # A short path: a shared connection's socket lies below it.
    with tempfile.TemporaryDirectory(prefix="lb-", dir="/tmp") as name, Host.start(**options) as host:
        home = Path(name) / "home"
        environment = furnish(host, home, SET_UP)
        yield Operator(host, home, {"PATH": PYTHON_PATH, "LC_ALL": "C.UTF-8", "SHELL": "/bin/bash", **environment})


@contextlib.contextmanager
def tools_of(someone: Operator) -> Iterator[Tools]:
    """pyinfra and Ansible in the same operator's hands."""
    from bench.peers.tools import Tools

    folder = someone.home.parent / "peers"
    folder.mkdir()
    key = folder / "key"
    key.write_bytes(someone.host.key.read_bytes())
    key.chmod(0o600)
    tools = Tools(folder, someone.host.robot.eth0, "mirte", key, someone.host.known_hosts)
    null = subprocess.DEVNULL
    opened = someone.host.run(tools.shared_connection("open"), stdout=null, stderr=null, env=tools.environment)
    if opened.returncode != 0:
        raise SystemExit(f"not measured: ssh to {tools.address} ended with {opened.returncode}")
    try:
        yield tools
    finally:
        someone.run(tools.shared_connection("exit"), tools.environment, 20.0)


# What a log-in goes through; their children are run as they are.
DAEMONS = ("systemd", "systemd-logind", "systemd-journal", "dbus-daemon", "sshd")


def take_the_cores(host: Host, stack: bool = False) -> None:
    """On a machine that others use: what is measured, on both ends of the cable, is run before everybody else's work.

    Nice values don't do that where the kernel groups processes by session. The simulated robot and our units over there keep
    their place, unless they are part of what is measured (`stack`).
    """
    from lupin_sim.host.missing import cgroup_roots

    os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    for root in cgroup_roots():
        for path in (root / f"lupin-host-{host.name}").rglob("cgroup.procs"):
            for pid in path.read_text().split():
                with contextlib.suppress(OSError):  # it ended meanwhile
                    if stack or Path(f"/proc/{pid}/comm").read_text().strip() in DAEMONS:
                        for task in Path(f"/proc/{pid}/task").iterdir():
                            os.sched_setscheduler(int(task.name), os.SCHED_RR, os.sched_param(1))


def median(runs: Sequence[float]) -> float:
    """To the millisecond."""
    return round(statistics.median(runs), 3)


def load() -> float:
    """How busy the machine was in the last minute: processes that ran or wanted to."""
    return round(os.getloadavg()[0], 1)
