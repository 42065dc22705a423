"""A whole diagnosis over SSH against the slowest of its probes, and against pyinfra and Ansible asking for the same facts.

Boots a robot's computer and types `lupin doctor --robot mirte` at the laptop: wall times of whole commands, interpreter and
imports included, in turns with the peers; medians. Whoever asks the slowest question waits for its answer: that is the limit.
The robot's own log of logins says how many connections it took.

What is fair: the peers ask the same by tasks of their own, as these tools are used: pyinfra by `server.Command` facts, Ansible
by `shell` tasks; once a task for each of our scripts, once for each question in them; once of the robot alone, and once of both
machines, as the doctor does (see peers/facts.py). They are at their best: pipelining, no facts of Ansible's own, its connection
open already, while ours and pyinfra connect anew. And they are spared: they judge nothing; ours measures one clock against the
other and runs all checks. What is not: neither is made for questions that don't depend on each other. Whoever wrote all scripts
into one task with `&` and `wait` would have written our batch.

`floor` is our way there alone: an interpreter, paramiko, one log-in, and a batch of one `true`. It takes as long as OpenSSH's
own client does (0.31 s, both), so that the ratio to the floor is what a doctor would reach that asks nothing.

The visit to the graph, which listens for a second or two by design, is left out where the peers are compared: they have none;
and the robot's stack doesn't run there, which would take the laptop's share of this machine's cores. `--graph` measures the
whole doctor on a healthy robot: the stack runs, our half of it too, and the graph is visited.

Whole commands on a shared machine take as long as others let them; `--busy` runs both ends before everybody else's work.

The cable between the two hosts takes no time; `--delay-ms` makes it the radio that most robots are reached over.

    python -m bench.bench_doctor [--rounds N] [--no-peers] [--way scripts|questions] [--delay-ms MS] [--graph] [--busy] [--json]

Needs root, as the host's tests do.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bench.booted import PROJECT_BENCH, Operator, Ran, load, median, operator, take_the_cores, tools_of
from bench.peers import facts as peers

if TYPE_CHECKING:
    from bench.peers.tools import Tools

FLOOR = """
import os, sys
from pathlib import Path
from lupin_cli.target.destination import Destination
from lupin_cli.target.reach import Knock
address, key, known_hosts = sys.argv[1:]
place = Destination(address, 22, "mirte", (key,), identities_only=True)
knock = Knock(place)
from lupin_cli.target.base import Script
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.trust import Trust
target = SshTarget("robot", place, Trust(Path(os.devnull), users=Path(known_hosts)), knock=knock)
target.get_ready()
ended = target.batch([Script("nothing", "true")])["nothing"].status
os._exit(0 if ended == 0 else 1)
"""
LIMIT_BEYOND_S, PYINFRA_LIMIT, ANSIBLE_LIMIT = 0.5, 10.0, 30.0
READY_BOUND_S = 90.0
REST_S = 1.0  # between commands: what one leaves to be cleared away is not the next one's time


def set_up(someone: Operator) -> dict[str, str]:
    """Join the robot's graph as an operator does; the environment of a terminal opened after that."""
    someone.must(someone.lupin("dds", "setup", someone.host.robot.eth0, "--shell", "bash"))
    shell = someone.run(["bash", "-c", ". ~/.config/lupin/ros-env.sh && env -0"])
    told = dict(line.split("=", 1) for line in shell.stdout.split("\0") if "=" in line)
    return {**someone.environment, **{name: told[name] for name in told if name.startswith(("ROS_", "RMW_", "FASTRTPS_"))}}


def logins(someone: Operator) -> int:
    """How many connections have been let in."""
    read = "journalctl --sync; journalctl -q -o cat -u ssh"
    return int(someone.host.robot.inside("sh", "-c", read).stdout.count("Accepted publickey"))


class Doctor:
    """`lupin doctor`, typed again and again."""

    def __init__(self, someone: Operator, environment: Mapping[str, str], *words: str) -> None:
        self._someone, self._environment = someone, environment
        self._note = someone.home / "slowest"
        self._command = [sys.executable, str(PROJECT_BENCH / "noting_probes.py"), str(self._note), "doctor"]
        self._command += ["--robot", "mirte", "--json", *words]
        self.walls: list[float] = []
        self.slowest: list[float] = []
        self.findings: set[str] = set()
        self.unknown: set[str] = set()

    def once(self) -> Ran:
        """One diagnosis."""
        ran = self._someone.must(self._someone.run(self._command, self._environment), 0, 1)
        told = json.loads(ran.stdout)
        self.walls.append(ran.wall_s)
        self.slowest.append(float(self._note.read_text()))
        self.findings |= {finding["id"] for finding in told["findings"]}
        self.unknown |= set(told["unknown"])
        return ran

    def until_healthy(self) -> None:
        """Ask until nothing is found: a robot that has just booted is not settled."""
        deadline = time.monotonic() + READY_BOUND_S
        while self.once().status != 0 and time.monotonic() < deadline:
            self.findings.clear()
            self.unknown.clear()
        self.walls.clear()
        self.slowest.clear()

    def told(self) -> dict[str, Any]:
        """What came of it."""
        beyond = [wall - slowest for wall, slowest in zip(self.walls, self.slowest)]
        return {
            "wall_s": median(self.walls),
            "slowest_probe_s": median(self.slowest),
            "beyond_slowest_s": median(beyond),
            "limit_beyond_s": LIMIT_BEYOND_S,
            "findings": sorted(self.findings),
            "unknown": sorted(self.unknown),
            "load": load(),
        }


def compared(
    rounds: int, with_peers: bool, busy: bool, delay_ms: float, ways: Sequence[str], note: Callable[[str], None]
) -> dict[str, Any]:
    """Everything but the visit to the graph, in turns with the peers."""
    with operator() as someone:
        doctor = Doctor(someone, set_up(someone), *(word for name in peers.visiting() for word in ("--skip", name)))
        if busy:
            take_the_cores(someone.host)
        if delay_ms:
            someone.host.robot.fault("slow-link", delay_ms=delay_ms, jitter_ms=delay_ms / 4.0)
        doctor.once()
        doctor.walls.clear()
        doctor.slowest.clear()
        before = logins(someone)
        for _ in range(rounds):
            doctor.once()
        result: dict[str, Any] = {"connections": round((logins(someone) - before) / rounds, 2)}
        result = {**doctor.told(), **result}
        if with_peers:
            with tools_of(someone) as tools:
                result["peers"] = {
                    f"{way} of {ends}": _in_turns(someone, doctor, tools, peers.asked(tools.address, way, ends), rounds, note)
                    for way in ways
                    for ends in peers.ENDS
                }
    return result


def _in_turns(
    someone: Operator, doctor: Doctor, tools: Tools, questions: peers.Questions, rounds: int, note: Callable[[str], None]
) -> dict[str, Any]:
    tasks = sum(map(len, questions.values()))
    commands = {"pyinfra": peers.pyinfra(tools, questions), "ansible": peers.ansible(tools, questions)}
    walls: dict[str, list[float]] = {"lupin": [], "pyinfra": [], "ansible": [], "floor": []}
    floor = [sys.executable, "-c", FLOOR, tools.address, str(tools.key), str(tools.known_hosts)]
    dice = random.Random(tasks)
    for round_ in range(rounds + 1):  # the first one warms caches
        for name in dice.sample(sorted(walls), len(walls)):  # nobody always comes after the one that leaves most behind
            time.sleep(REST_S)
            if name == "lupin":
                ran = doctor.once()
            elif name == "floor":
                ran = someone.must(someone.run(floor))
            else:
                ran = someone.must(someone.run(commands[name], tools.environment))
                peers.must_have_answered(name, ran.stdout + ran.stderr, questions, tools)
            walls[name].append(ran.wall_s)
        note(f"{tasks} tasks, round {round_}: " + ", ".join(f"{n} {w[-1]:.2f} s" for n, w in walls.items()))
    found: dict[str, Any] = {"tasks": tasks, **{f"{name}_s": median(w[1:]) for name, w in walls.items()}}
    for name, limit in (("pyinfra", PYINFRA_LIMIT), ("ansible", ANSIBLE_LIMIT)):
        times = {
            ours: round(median([theirs / own for theirs, own in zip(walls[name][1:], walls[ours][1:])]), 1)
            for ours in ("lupin", "floor")
        }
        found |= {f"{name}_times": times["lupin"], f"{name}_wanted": limit, f"{name}_times_the_floor": times["floor"]}
    return {**found, "load": load()}


def whole(rounds: int, busy: bool, note: Callable[[str], None]) -> dict[str, Any]:
    """The whole doctor with its visit, on a robot whose stack and whose half of Lupin run."""
    with operator(vendor_robot=True) as someone:
        someone.must(someone.lupin("deploy", "robot", "--no-check"))
        doctor = Doctor(someone, set_up(someone))
        doctor.until_healthy()
        if busy:
            take_the_cores(someone.host, stack=True)
        for round_ in range(rounds):
            doctor.once()
            note(f"with the graph, round {round_}: {doctor.walls[-1]:.2f} s, slowest probe {doctor.slowest[-1]:.2f} s")
    return doctor.told()


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--no-peers", action="store_true", help="Ours alone; nothing is installed.")
    parser.add_argument("--way", action="append", choices=peers.WAYS, help="How the peers ask; else one after the other.")
    parser.add_argument("--delay-ms", type=float, default=0.0, help="Of the link, each way, as a radio has it.")
    parser.add_argument("--graph", action="store_true", help="The whole doctor too, with its visit to the graph.")
    parser.add_argument("--busy", action="store_true", help="Others use this machine: run what is measured before their work.")
    parser.add_argument("--json", action="store_true", help="Print one line of JSON, alone on standard output.")
    options = parser.parse_args()

    def note(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    result = compared(options.rounds, not options.no_peers, options.busy, options.delay_ms, options.way or peers.WAYS, note)
    if options.graph:
        result["with_the_graph"] = whole(options.rounds, options.busy, note)
    if options.json:
        print(json.dumps(result))
    else:
        for key, value in result.items():
            for name, row in value.items() if key == "peers" else [("", value)]:
                print(f"{key} {name}".ljust(22), json.dumps(row))
    return 0 if result["beyond_slowest_s"] <= LIMIT_BEYOND_S and result["connections"] <= 1.0 else 1


if __name__ == "__main__":
    sys.exit(main())
