"""The robot's own part of the stack: time from a unit's start to its use, memory, and processor time at rest.

The benchmark boots a simulated computer whose vendor's stack is the simulated robot, and deploys to it. Then lupin-onboard is
restarted in rounds. It is usable when systemd has its READY=1: samples of e-stop and drive bus were received, and the arm's
service answers; the start includes the verification of the release. At rest, nothing moves, and the vendor's topics arrive at
their rates. Memory is the sum of the processes' shares (PSS), which counts shared pages once, and the peak of it while the
supervisor looked, every 10 s.

The peer is one plain rclpy node in the unit's environment (`peers/plain_node.py`), which receives the button and the joint
states, and repeats as many messages as e-stop and drive bus. It decides nothing: its processor time is that of rclpy.

Needs root, as the tests on booted hosts do. The times are those of this machine: the robot's cores are several times slower.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Annotated

from bench.booted import Operator, booted_operator, load_average, median, raise_priority
from bench.runner import Busy, Figures, Rounds, Seconds, benchmark, note

UNIT = "lupin-onboard"
PEER, PEER_UNIT = Path(__file__).parent / "peers" / "plain_node.py", "lupin-bench-peer"
START_TIMEOUT_S = 90.0
# Of each process of the unit: its name, the CPU time of it in clock ticks, and its share of memory in kB.
READ_PROCESSES = f"""cat /proc/uptime
for p in $(pgrep -f '^/[^ ]*python3 .*lupin_runtime\\.stack\\.(onboard|process /run/{UNIT}/)'); do
  name=$(tr '\\0' '\\n' < /proc/$p/cmdline | tail -n 1 | sed 's,.*/,,; s,\\.json$,,; s,.*\\.,,')
  echo "$name $(sed 's/.*) //' /proc/$p/stat | cut -d' ' -f12,13) $(awk '/^Pss:/ {{print $2}}' /proc/$p/smaps_rollup)"
done"""


# Start the peer, whose text is on standard input, as the unit starts its own program; print its process.
START_PEER = f"""cat > /tmp/plain_node.py; chmod 644 /tmp/plain_node.py
sed -n 's/^ExecStart=/exec /p' /etc/systemd/system/{UNIT}.service |
  sed 's,-m lupin_runtime\\.stack\\.onboard,/tmp/plain_node.py,; s/[$][$]/$/g' > /tmp/plain_node.sh
user=$(systemctl show {UNIT} --property=User --value)
systemd-run --quiet --collect --unit={PEER_UNIT} --uid="$user" --setenv=FASTDDS_BUILTIN_TRANSPORTS=UDPv4 bash /tmp/plain_node.sh
sleep 8; systemctl show {PEER_UNIT} --property=MainPID --value"""
READ_PEER = "cat /proc/uptime; sed 's/.*) //' /proc/{pid}/stat | cut -d' ' -f12,13"


def start_s(operator: Operator) -> float:
    """Restart the unit, and return how long its start took, in seconds."""
    run_as_root = operator.host.robot.run_as_root
    done = run_as_root("systemctl", "restart", UNIT, timeout_s=START_TIMEOUT_S)
    if done.status != 0:
        raise SystemExit(f"not measured: {UNIT} did not start: {done.stderr}")
    properties = ("InactiveExitTimestampMonotonic", "ActiveEnterTimestampMonotonic")
    shown = run_as_root("systemctl", "show", UNIT, *(f"--property={name}" for name in properties)).stdout
    values = dict(line.split("=") for line in shown.splitlines())
    return (int(values[properties[1]]) - int(values[properties[0]])) / 1e6


def read_processes(operator: Operator) -> tuple[float, dict[str, tuple[float, float]]]:
    """Return the robot's uptime in s, and by process its CPU time in s and its memory in MB."""
    first, *lines = operator.host.robot.run_as_root("sh", "-c", READ_PROCESSES).stdout.splitlines()
    found = {}
    for name, user, system, kilobytes in (line.split() for line in lines):
        found["supervisor" if name == "onboard" else name] = ((int(user) + int(system)) / 100, int(kilobytes) * 1024 / 1e6)
    return float(first.split()[0]), found


def peer_percent(operator: Operator, seconds: float) -> float:
    """Return the processor time of the peer, in percent of one core."""
    run_as_root = operator.host.robot.run_as_root
    started = run_as_root("sh", "-c", START_PEER, stdin=PEER.read_text())
    if started.status != 0 or not started.stdout.strip().isdigit():
        raise SystemExit(f"not measured: the peer did not start: {started.stderr}")

    def read() -> tuple[float, float]:
        uptime, ticks = run_as_root("sh", "-c", READ_PEER.format(pid=int(started.stdout))).stdout.splitlines()
        return float(uptime.split()[0]), sum(map(int, ticks.split())) / 100

    began_s, before_s = read()
    time.sleep(seconds)
    ended_s, after_s = read()
    return 100 * (after_s - before_s) / (ended_s - began_s)


def peak_mb(operator: Operator) -> float:
    """Return the largest memory of the unit's processes that the supervisor saw, in MB."""
    shown = operator.host.robot.run_as_root("sh", "-c", f"cat /run/{UNIT}/lupin/runs/*/state.json").stdout
    return float(json.loads(shown)["memory_peak_mb"])


@benchmark(at_most={"usable_worst_s": 4.0, "memory_mb": 256.0, "memory_peak_mb": 256.0, "cpu_percent": 5.0})
def main(
    rounds: Rounds = 5,
    seconds: Seconds = 30.0,
    settle: Annotated[float, "wait this many seconds after a start before processor time is measured"] = 20.0,
    busy: Busy = False,
) -> Figures:
    """Restart the unit in rounds, then measure the last start's processes at rest."""
    with booted_operator(vendor_robot=True) as operator:
        operator.require(operator.lupin("deploy", "robot", "--no-check", "--json"))
        if busy:
            raise_priority(operator.host, stack=True)
        starts = []
        for round_ in range(rounds):
            starts.append(start_s(operator))
            note(f"round {round_}: usable after {starts[-1]:.2f} s")
        time.sleep(settle)
        began_s, before = read_processes(operator)
        time.sleep(seconds)
        ended_s, after = read_processes(operator)
        percent = {name: 100 * (after[name][0] - before[name][0]) / (ended_s - began_s) for name in before}
        return {
            "usable_s": median(starts),
            "usable_worst_s": max(starts),
            "memory_mb": sum(memory for _, memory in after.values()),
            "memory_peak_mb": peak_mb(operator),
            "cpu_percent": sum(percent.values()),
            "peer_cpu_percent": peer_percent(operator, seconds),
            "processes": {name: {"cpu": percent[name], "memory": after[name][1]} for name in before},
            "load_average": load_average(),
        }


if __name__ == "__main__":
    sys.exit(main())
