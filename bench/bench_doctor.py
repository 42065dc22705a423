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

    python -m bench.bench_doctor [--rounds N] [--no-peers] [--way scripts|questions] [--delay-ms MS] [--graph] [--busy] [--json]

Needs root, as the tests on booted hosts do.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bench.booted import (
    PROJECT_BENCH,
    Operator,
    TimedRun,
    add_common_options,
    booted_operator,
    load_average,
    median,
    note,
    peer_tools,
    raise_priority,
)
from bench.peers import facts as peers

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
LIMIT_S = 1.0  # below it, the doctor feels instant
GRAPH_LIMIT_S = 3.0  # with ground truth
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
            "limit_s": LIMIT_S,
            "findings": sorted(self.findings),
            "unknown": sorted(self.unknown),
            "load_average": load_average(),
        }


def compare(
    rounds: int, with_peers: bool, busy: bool, delay_ms: float, task_sizes: Sequence[str], note: Callable[[str], None]
) -> dict[str, Any]:
    """Measure the doctor without the checks of the ROS graph, and the peers if asked to; `note` prints progress."""
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
                        session, doctor, tools, peers.questions_for(tools.address, size, machines), rounds, note
                    )
                    for size in task_sizes
                    for machines in peers.MACHINES
                }
    return result


def _compare_with_peers(
    session: Operator,
    doctor: DoctorRuns,
    tools: PeerTools,
    questions: peers.Questions,
    rounds: int,
    note: Callable[[str], None],
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
            base: round(median([peer / ours for peer, ours in zip(walls[name][1:], walls[base][1:])]), 1)
            for base in ("lupin", "floor")
        }
        summary |= {f"{name}_ratio": ratios["lupin"], f"{name}_min_ratio": limit, f"{name}_ratio_to_floor": ratios["floor"]}
    return {**summary, "load_average": load_average()}


def passes(result: Mapping[str, Any]) -> bool:
    """Whether the doctor is as fast as it must be, over one connection; with the graph, too, if that was measured."""
    whole = result.get("with_the_graph")
    in_time = result["wall_s"] <= LIMIT_S and (whole is None or whole["wall_s"] <= whole["limit_s"])
    return bool(in_time and result["connections"] <= 1.0)


def measure_whole(rounds: int, busy: bool, note: Callable[[str], None]) -> dict[str, Any]:
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
    return {**doctor.report(), "limit_s": GRAPH_LIMIT_S}


def main() -> int:
    """Time the doctor and its peers; return 1 if the doctor exceeds a limit or opens more than one connection."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5, help="repeat each measurement this many times")
    parser.add_argument(
        "--no-peers", action="store_true", help="measure the doctor only, and do not install pyinfra and Ansible"
    )
    parser.add_argument(
        "--way",
        action="append",
        choices=peers.TASK_SIZES,
        help="give pyinfra and Ansible tasks of this size; may be repeated; default: both",
    )
    parser.add_argument("--delay-ms", type=float, default=0.0, help="delay packets by this time in each direction")
    parser.add_argument("--graph", action="store_true", help="also measure the whole doctor, with the checks of the ROS graph")
    add_common_options(parser)
    options = parser.parse_args()

    sizes = options.way or peers.TASK_SIZES
    result = compare(options.rounds, not options.no_peers, options.busy, options.delay_ms, sizes, note)
    if options.graph:
        result["with_the_graph"] = measure_whole(options.rounds, options.busy, note)
    if options.json:
        print(json.dumps(result))
    else:
        for key, value in result.items():
            for name, row in value.items() if key == "peers" else [("", value)]:
                print(f"{key} {name}".ljust(22), json.dumps(row))
    return 0 if passes(result) else 1


if __name__ == "__main__":
    sys.exit(main())
