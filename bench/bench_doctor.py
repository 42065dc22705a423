"""The wall time of `lupin doctor` over SSH, compared with its slowest probe and with pyinfra and Ansible for the same facts.

Boots a simulated robot and runs `lupin doctor --robot mirte` on the laptop. Times are medians of whole commands, interpreter
and imports included, in random order with pyinfra and Ansible, its peers. No doctor can be faster than its slowest probe, so
that is the reference. The robot's SSH log gives the number of connections.

The comparison is fair in these points: the peers gather the same facts as these tools usually do (pyinfra by `server.Command`
facts, Ansible by `shell` tasks), once with a task for each of Lupin's scripts and once with a task for each probe in them, once
from the robot alone and once from both machines, as the doctor does (see peers/facts.py). Both have their best settings:
pipelining, none of Ansible's own facts, and an open connection for Ansible, while pyinfra and the doctor connect each time.
They judge nothing, while the doctor also compares the clocks and runs all checks. It is unfair in one point: neither peer is
made for independent probes. A user who put all scripts into one task with `&` and `wait` would have rewritten Lupin's batch.

`floor` is the connection alone: an interpreter, paramiko, one login, and a batch of one `true`. It takes as long as OpenSSH's
client (both 0.31 s), so the ratio to the floor is what a doctor without probes would reach.

The comparison leaves out the checks of the ROS graph, which listen for a second or two by design and which the peers lack. The
robot's stack does not run, because it would take CPU from the laptop. `--graph` measures the whole doctor on a healthy robot
with the vendor's stack and Lupin's units running.

On a shared machine, other work changes the times; `--busy` gives both simulated machines priority over it.

The cable between the two machines adds no delay; `--delay-ms` adds a delay like that of a radio.

Needs root, as the tests on booted hosts do.
"""

from __future__ import annotations

import json
import random
import sys
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

from bench.booted import (
    PROJECT_BENCH,
    Operator,
    TimedRun,
    booted_operator,
    load_average,
    median,
    peer_tools,
    raise_priority,
)
from bench.peers import facts as peers
from bench.runner import Busy, Figures, NoPeers, Rounds, benchmark, note

if TYPE_CHECKING:
    from bench.peers.pyinfra_and_ansible import PeerTools

FLOOR = """
import os, sys
from pathlib import Path
from lupin_cli.connection.destination import Destination
address, key, known_hosts = sys.argv[1:]
destination = Destination(address, 22, "mirte", (key,), identities_only=True)
from lupin_cli.connection.base import Script
from lupin_cli.connection.ssh import SshTarget
from lupin_cli.connection.host_keys import KnownHosts
target = SshTarget("robot", destination, KnownHosts(Path(os.devnull), user_file=Path(known_hosts)))
status = target.batch([Script("nothing", "true")])["nothing"].status
sys.exit(0 if status == 0 else 1)
"""
# How many times as long as the doctor the peers should take; printed for comparison, and not part of the exit status.
MIN_PYINFRA_RATIO, MIN_ANSIBLE_RATIO = 5.0, 20.0
READY_TIMEOUT_S = 90.0
PAUSE_S = 1.0  # between commands, so that the cleanup after one does not slow down the next


def set_up(session: Operator) -> dict[str, str]:
    """Run `lupin dds setup`, and return the environment of a terminal opened after it."""
    session.require(session.lupin("dds", "setup", session.host.robot.eth0, "--shell", "bash"))
    shell = session.run(["bash", "-c", ". ~/.config/lupin/ros-env.sh && env -0"])
    report = dict(line.split("=", 1) for line in shell.stdout.split("\0") if "=" in line)
    return {**session.environment, **{name: report[name] for name in report if name.startswith(("ROS_", "RMW_", "FASTRTPS_"))}}


def count_logins(session: Operator) -> int:
    """Return how many SSH logins the robot has accepted."""
    read = "journalctl --sync; journalctl -q -o cat -u ssh"
    return int(session.host.robot.run_as_root("sh", "-c", read).stdout.count("Accepted publickey"))


class DoctorRuns:
    """Runs `lupin doctor` repeatedly, and records times and findings."""

    def __init__(self, session: Operator, environment: Mapping[str, str], *words: str) -> None:
        self._session, self._environment = session, environment
        self._probe_times = session.home / "slowest"
        self._command = [sys.executable, str(PROJECT_BENCH / "probe_timing.py"), str(self._probe_times), "doctor"]
        self._command += ["--robot", "mirte", "--json", *words]
        self.walls: list[float] = []
        self.slowest: list[float] = []
        self.findings: set[str] = set()
        self.unknown: set[str] = set()

    def run(self) -> TimedRun:
        """Run the doctor once."""
        ran = self._session.require(self._session.run(self._command, self._environment), 0, 1)
        report = json.loads(ran.stdout)
        self.walls.append(ran.wall_s)
        self.slowest.append(float(self._probe_times.read_text()))
        self.findings |= {finding["id"] for finding in report["findings"]}
        self.unknown |= set(report["unknown"])
        return ran

    def until_healthy(self) -> None:
        """Run the doctor until it finds nothing, for at most READY_TIMEOUT_S: a robot that has just booted needs time."""
        deadline = time.monotonic() + READY_TIMEOUT_S
        while self.run().status != 0 and time.monotonic() < deadline:
            self.findings.clear()
            self.unknown.clear()
        self.walls.clear()
        self.slowest.clear()

    def report(self) -> dict[str, Any]:
        """Return the medians, findings and unknown facts of all runs."""
        above_slowest = [wall - slowest for wall, slowest in zip(self.walls, self.slowest)]
        return {
            "wall_s": median(self.walls),
            "slowest_probe_s": median(self.slowest),
            "above_slowest_s": median(above_slowest),
            "findings": sorted(self.findings),
            "unknown": sorted(self.unknown),
            "load_average": load_average(),
        }


def compare(rounds: int, with_peers: bool, busy: bool, delay_ms: float, task_sizes: Sequence[str]) -> dict[str, Any]:
    """Measure the doctor without the checks of the ROS graph, and the peers if asked to."""
    with booted_operator() as session:
        doctor = DoctorRuns(session, set_up(session), *(word for name in peers.graph_checks() for word in ("--skip", name)))
        if busy:
            raise_priority(session.host)
        if delay_ms:
            session.host.robot.inject_fault("slow-link", delay_ms=delay_ms, jitter_ms=delay_ms / 4.0)
        doctor.run()
        doctor.walls.clear()
        doctor.slowest.clear()
        before = count_logins(session)
        for _ in range(rounds):
            doctor.run()
        result: dict[str, Any] = {"connections": round((count_logins(session) - before) / rounds, 2)}
        result = {**doctor.report(), **result}
        if with_peers:
            with peer_tools(session) as tools:
                result["peers"] = {
                    f"{size}, {machines}": _compare_with_peers(
                        session, doctor, tools, peers.questions_for(tools.address, size, machines), rounds
                    )
                    for size in task_sizes
                    for machines in peers.MACHINES
                }
    return result


def _compare_with_peers(
    session: Operator, doctor: DoctorRuns, tools: PeerTools, questions: peers.Questions, rounds: int
) -> dict[str, Any]:
    tasks = sum(map(len, questions.values()))
    commands = {"pyinfra": peers.pyinfra_command(tools, questions), "ansible": peers.ansible_command(tools, questions)}
    walls: dict[str, list[float]] = {"lupin": [], "pyinfra": [], "ansible": [], "floor": []}
    floor = [sys.executable, "-c", FLOOR, tools.address, str(tools.key), str(tools.known_hosts)]
    random_order = random.Random(tasks)
    for round_ in range(rounds + 1):  # the first one warms caches
        # A random order, so that no tool always runs after the one that leaves most work behind.
        for name in random_order.sample(sorted(walls), len(walls)):
            time.sleep(PAUSE_S)
            if name == "lupin":
                ran = doctor.run()
            elif name == "floor":
                ran = session.require(session.run(floor))
            else:
                ran = session.require(session.run(commands[name], tools.environment))
                peers.require_all_answers(name, ran.stdout + ran.stderr, questions, tools)
            walls[name].append(ran.wall_s)
        note(f"{tasks} tasks, round {round_}: " + ", ".join(f"{n} {w[-1]:.2f} s" for n, w in walls.items()))
    summary: dict[str, Any] = {"tasks": tasks, **{f"{name}_s": median(w[1:]) for name, w in walls.items()}}
    for name, limit in (("pyinfra", MIN_PYINFRA_RATIO), ("ansible", MIN_ANSIBLE_RATIO)):
        ratios = {
            base: median([peer / ours for peer, ours in zip(walls[name][1:], walls[base][1:])]) for base in ("lupin", "floor")
        }
        summary |= {f"{name}_ratio": ratios["lupin"], f"{name}_min_ratio": limit, f"{name}_ratio_to_floor": ratios["floor"]}
    return {**summary, "load_average": load_average()}


def measure_whole(rounds: int, busy: bool) -> dict[str, Any]:
    """Measure the whole doctor on a robot with the vendor's stack and Lupin's units running."""
    with booted_operator(vendor_robot=True) as session:
        session.require(session.lupin("deploy", "robot", "--no-check"))
        doctor = DoctorRuns(session, set_up(session))
        doctor.until_healthy()
        if busy:
            raise_priority(session.host, stack=True)
        for round_ in range(rounds):
            doctor.run()
            note(f"with the graph, round {round_}: {doctor.walls[-1]:.2f} s, slowest probe {doctor.slowest[-1]:.2f} s")
    return doctor.report()


# Below 1 s, the doctor feels instant. With the graph, it measures ground truth.
@benchmark(at_most={"wall_s": 1.0, "with_the_graph.wall_s": 3.0, "connections": 1.0})
def main(
    rounds: Rounds = 5,
    no_peers: NoPeers = False,
    way: Annotated[tuple[str, ...], "give the peers tasks of this size; may be repeated", peers.TASK_SIZES] = (),
    delay_ms: Annotated[float, "delay packets by this time in each direction"] = 0.0,
    graph: Annotated[bool, "also measure the whole doctor, with the checks of the ROS graph"] = False,
    busy: Busy = False,
) -> Figures:
    """Time the doctor and its peers."""
    figures = compare(rounds, not no_peers, busy, delay_ms, way or peers.TASK_SIZES)
    return figures | {"with_the_graph": measure_whole(rounds, busy)} if graph else figures


if __name__ == "__main__":
    sys.exit(main())
