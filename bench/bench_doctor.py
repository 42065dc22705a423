"""A whole diagnosis over SSH against the slowest of its probes, and against one ssh process for each fact of the robot.

Boots a robot's computer and examines it from the laptop's side of the cable, as `lupin doctor` does: connect, ask both ends at
the same time, judge. The limit is the slowest probe of either machine in the same run: nothing that asks for it can be faster.
The robot's own log of logins says how many connections it took. Visits to a graph (seconds of listening, by design) are left
out unless --graph asks for them.

    python -m bench.bench_doctor [--rounds N] [--graph] [--json]      needs root, as the host's tests do
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lupin_cli.checks.base import Check
from lupin_cli.target.base import Output, Script

ADDRESS = "10.42.0.1"
SSH_LOG = ("journalctl", "-q", "-o", "cat", "-u", "ssh")


class Timed:
    """A target that remembers how long its probes took."""

    def __init__(self, target: Any) -> None:
        self._target = target
        self.slowest_s = 0.0
        self.name, self.user = target.name, target.user

    def batch(self, scripts: Sequence[Script], bound_s: float = 10.0) -> dict[str, Output]:
        outputs: dict[str, Output] = self._target.batch(scripts, bound_s)
        self.slowest_s = max((output.duration_s for output in outputs.values()), default=0.0)
        return outputs


def chosen(graph: bool) -> tuple[Check, ...]:
    """The built-in checks, without those that listen to a graph unless asked for."""
    from lupin_cli.checks.table import built_in

    return tuple(
        check for check in built_in() if graph or not any(fact.name == "graph" for fact in (*check.laptop, *check.robot))
    )


def examine_once(checks: Sequence[Check]) -> dict[str, Any]:
    """One diagnosis from nothing, as a command makes it."""
    from lupin_cli.config import load
    from lupin_cli.diagnosis import diagnose, gather
    from lupin_cli.facts.link import Link
    from lupin_cli.robot_options import connect, named
    from lupin_cli.target.local import LocalTarget

    start = time.perf_counter()
    laptop: Any = Timed(LocalTarget())
    config = load()
    with connect(named(config, "mirte"), config) as target:
        robot: Any = Timed(target)
        evidence = gather(checks, laptop, lambda: (robot, Link("mirte", ADDRESS)), Link("mirte", ADDRESS), [ADDRESS])
        diagnosis = diagnose(checks, evidence)
        wall_s = time.perf_counter() - start
    return {
        "wall_s": wall_s,
        "slowest_probe_s": max(laptop.slowest_s, robot.slowest_s),
        "findings": [root.finding.id for root in diagnosis.roots],
        "unknown": list(diagnosis.unknown),
    }


def one_ssh_each(checks: Sequence[Check], key: str, known_hosts: str) -> float:
    """The peer: the same probes of the robot, one ssh process and connection each; seconds for all."""
    from lupin_cli.diagnosis import facts_of

    start = time.perf_counter()
    for fact in facts_of(checks, "robot"):
        options = ["-F", "none", "-o", "BatchMode=yes", "-o", f"UserKnownHostsFile={known_hosts}", "-i", key]
        subprocess.run(["ssh", *options, f"mirte@{ADDRESS}", fact.probe], capture_output=True, timeout=60, check=False)
    return time.perf_counter() - start


def on_the_laptop(rounds: int, graph: bool) -> None:
    """What runs on the laptop's side: prints one line of JSON."""
    checks = chosen(graph)
    home = Path(os.environ["HOME"])
    examine_once(checks)  # imports are paid once by a command, not by every diagnosis
    runs = [examine_once(checks) for _ in range(rounds)]
    peer_s = one_ssh_each(checks, str(home / ".ssh" / "id_ed25519"), str(home / ".ssh" / "known_hosts"))
    print(json.dumps({"runs": runs, "peer_s": peer_s, "checks": len(checks)}))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--graph", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--on-the-laptop", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.on_the_laptop:
        on_the_laptop(options.rounds, options.graph)
        return
    from lupin_sim.host import Host
    from lupin_sim.host.host import PROJECT

    with Host.start() as host, tempfile.TemporaryDirectory() as name:
        home = Path(name)
        (home / ".ssh").mkdir(mode=0o700)
        shutil.copy(host.key, home / ".ssh" / "id_ed25519")
        (home / ".ssh" / "id_ed25519").chmod(0o600)
        shutil.copy(host.known_hosts, home / ".ssh" / "known_hosts")
        (home / ".config" / "lupin").mkdir(parents=True)
        (home / ".config" / "lupin" / "lupin.toml").write_text(f'[robots.mirte.addresses]\nwired = "{ADDRESS}"\n')
        command = [sys.executable, "-m", "bench.bench_doctor", "--on-the-laptop", "--rounds", str(options.rounds)]
        environment = {"PATH": "/usr/bin:/bin:/usr/sbin:/sbin", "HOME": str(home)}
        before = _logins(host.robot.inside(*SSH_LOG).stdout)
        done = host.run([*command, *(["--graph"] if options.graph else [])], env=environment, cwd=str(PROJECT), timeout_s=600.0)
        if done.returncode != 0:
            raise SystemExit(done.stderr)
        told = json.loads(done.stdout)
        host_log = host.robot.inside(*SSH_LOG).stdout
    runs, probes = told["runs"], _probes(options.graph)
    beyond = [run["wall_s"] - run["slowest_probe_s"] for run in runs]
    result = {
        "checks": told["checks"],
        "rounds": options.rounds,
        "wall_s": round(statistics.median(run["wall_s"] for run in runs), 3),
        "slowest_probe_s": round(statistics.median(run["slowest_probe_s"] for run in runs), 3),
        "beyond_slowest_s": round(statistics.median(beyond), 3),
        # The first diagnosis, which paid the imports, connected too; so did the peer, once a probe.
        "connections_per_diagnosis": round((_logins(host_log) - before - probes) / (options.rounds + 1), 2),
        "one_ssh_each_s": round(told["peer_s"], 3),
        "faster_by": round(told["peer_s"] / statistics.median(run["wall_s"] for run in runs), 1),
        "findings": sorted({finding for run in runs for finding in run["findings"]}),
        "unknown": sorted({line for run in runs for line in run["unknown"]}),
    }
    if options.json:
        print(json.dumps(result))
        return
    for key, value in result.items():
        print(f"{key:26} {value}")


def _logins(log: str) -> int:
    return log.count("Accepted publickey")


def _probes(graph: bool) -> int:
    from lupin_cli.diagnosis import facts_of

    return len(facts_of(chosen(graph), "robot"))


if __name__ == "__main__":
    main()
