"""What happens when a process hangs or dies while the robot drives, for every process of a simulated run.

    python -m bench.bench_hang [--signal STOP|KILL] [--source goal|teleop|mission|browser]
        [--only REGEX] [--load N] [--json]

Starts the stack with `lupin up`. For each process: let the robot drive, send the signal, and measure when the wheels are at
rest, when `lupin status` reports it, and when the process is replaced. Limits: at rest within 1.0 s (KILL: 0.35 s), reported
within 3 s. With `--source browser` a client of the console drives, and only the console is disturbed (0.5 s). A stopped
supervisor replaces nothing: it is continued after it was reported. `--load` runs this many busy processes beside it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

from websockets.exceptions import ConnectionClosed

from bench.detached_run import start_run, stop_run
from lupin_runtime import graph
from lupin_runtime.console.description import read_description
from lupin_runtime.stack.alarms import alarms
from lupin_runtime.stack.runs import Run
from tests.support.console_browser import Browser
from tests.support.release_rig import ReleaseRig
from tests.support.rosbridge_client import RosbridgeClient

LIMIT_REST_S = {"STOP": 1.0, "KILL": 0.35}
LIMIT_CONSOLE_REST_S = 0.5
LIMIT_REPORTED_S = 3.0
SUPERVISOR, CONSOLE = "supervisor", "console"
# The run ends with the simulator, and the mission with its process: these come last.
LAST = ("mission", SUPERVISOR, "sim")
MOVING_M_S = 0.02
REST_S = 0.3
WATCH_S, REPLACED_TIMEOUT_S = 3.5, 40.0
STATUS_ARGUMENTS = ("-m", "lupin_cli.app", "status", "--json", "--run")


@dataclass(frozen=True)
class Result:
    """Seconds from the signal; None where it did not happen."""

    at_rest_s: float | None
    reported_s: float | None
    status_exit: int
    replaced_s: float | None
    why: str

    def within(self, limit_rest_s: float) -> bool:
        """Whether the wheels came to rest in time, and `lupin status` reported it in time and by its exit status."""
        rested = self.at_rest_s is not None and self.at_rest_s <= limit_rest_s
        return rested and self.reported_s is not None and self.reported_s <= LIMIT_REPORTED_S and self.status_exit != 0


class HangRig(ReleaseRig):
    """A client that also records the speed of the base."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.speeds: list[tuple[float, float]] = []
        super().__init__(run.path)
        self.node.subscription(graph.ODOM, self._on_odom)

    def _on_odom(self, message: Any) -> None:
        twist = message.twist.twist
        self.speeds.append((time.monotonic(), math.hypot(twist.linear.x, twist.linear.y) + 0.1 * abs(twist.angular.z)))

    def stage(self, name: str) -> dict[str, Any]:
        """A stage of the run's last state."""
        return next((stage for stage in self.run.state().get("stages", []) if stage["name"] == name), {})

    def drive(self, source: str) -> None:
        """Let the robot drive, and return while it does."""
        self.sign = -self.sign
        if source == "teleop":
            self.rest_then_stream(graph.CMD_VEL_MANUAL)
        elif source == "goal":
            self.go()
        elif source == "browser":
            self._browse()
        self.until(lambda: self.speeds and self.speeds[-1][1] > 0.1, "motion", 60.0)

    def _browse(self) -> None:
        """Drive by a client of the console, until that does not take it any more."""
        console = read_description(self.run.path)
        assert console is not None
        browser, client = Browser(console.port), RosbridgeClient(console.rosbridge_port)
        browser.get("/")
        # A console that was lost has left the stop engaged.
        self.until(lambda: browser.post("/_api/stop", engaged=False)["stop"] == [], "the release", 20.0)

        def stream() -> None:
            with suppress(ConnectionClosed, OSError):
                while True:
                    client.send("publish", topic=graph.CMD_VEL_MANUAL.name, msg={"linear": {"x": 0.3 * self.sign}})
                    time.sleep(0.05)

        client.send("publish", topic=graph.CMD_VEL_MANUAL.name, msg={})
        threading.Thread(target=stream, daemon=True).start()

    def disturb(self, name: str, number: signal.Signals, source: str) -> Result:
        """Send a signal to the process `name` while the robot drives."""
        self.drive(source)
        pid = self.run.info()["pid"] if name == SUPERVISOR else self.stage(name)["pid"]
        self.speeds.clear()
        began_s = time.monotonic()
        os.kill(pid, number)
        reported_s, status_exit, replaced_s = None, 0, None
        deadline = began_s + REPLACED_TIMEOUT_S
        while time.monotonic() < deadline:
            elapsed_s = time.monotonic() - began_s
            stage = self.stage(name)
            if reported_s is None and (alarms(self.run.state()) or (stage.get("phase") != "up" and name != SUPERVISOR)):
                reported_s = elapsed_s
                status_exit = subprocess.run(
                    [sys.executable, *STATUS_ARGUMENTS, self.run.id], check=False, stdout=subprocess.DEVNULL, timeout=30
                ).returncode
            if name == SUPERVISOR and reported_s is not None and elapsed_s > WATCH_S:
                os.kill(pid, signal.SIGCONT)
                break
            if replaced_s is None and stage.get("pid") not in (pid, None) and stage.get("phase") == "up":
                replaced_s = elapsed_s
            if not self.run.alive() or (replaced_s is not None and elapsed_s > WATCH_S):
                break
            time.sleep(0.02)
        state = self.run.state()
        deaths = state.get("deaths") or state.get("outcome", {}).get("deaths") or [{}]
        why = f"{deaths[-1].get('status', '')}: {deaths[-1].get('consequence', '')}" if name != SUPERVISOR else "continued"
        self._streams = dict.fromkeys(self._streams)
        return Result(_at_rest_s(list(self.speeds), began_s), reported_s, status_exit, replaced_s, why)


def _at_rest_s(speeds: list[tuple[float, float]], began_s: float) -> float | None:
    """Seconds until the base stood still for REST_S, or until its last message."""
    rest_s: float | None = None
    for time_s, speed in speeds:
        if speed > MOVING_M_S:
            rest_s = None
        elif rest_s is None:
            rest_s = time_s
        elif time_s - rest_s > REST_S:
            return max(0.0, rest_s - began_s)
    if rest_s is None and (not speeds or time.monotonic() - speeds[-1][0] > REST_S):
        rest_s = speeds[-1][0] if speeds else began_s  # the world itself has stopped
    return None if rest_s is None else max(0.0, rest_s - began_s)


def measure_all(names: str, number: signal.Signals, source: str, world: str) -> dict[str, Result]:
    """Measure every process whose name matches."""
    options = {"mission": ["--mission"], "browser": ["--web"]}
    arguments = ["--world", world, *options.get(source, [])]
    results: dict[str, Result] = {}
    run, rig = start_run(arguments), None
    try:
        present = [stage["name"] for stage in run.state()["stages"]] + [SUPERVISOR]
        ordered = [name for name in present if name not in LAST] + [name for name in LAST if name in present]
        for name in ordered:
            if not re.search(names, name) or (name == SUPERVISOR and number == signal.SIGKILL):
                continue
            if source == "browser" and name != CONSOLE:
                continue
            if rig is None or not run.alive():
                run = run if run.alive() else start_run(arguments)
                rig = HangRig(run)
            results[name] = rig.disturb(name, number, source)
            print(name, results[name], file=sys.stderr, flush=True)
            time.sleep(2.0)
        return results
    finally:
        if rig is not None:
            rig.close()
        if run.alive():
            stop_run(run)


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f} s"


def main() -> int:
    """Print the table; return 1 if a limit was missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--signal", choices=sorted(LIMIT_REST_S), default="STOP")
    parser.add_argument("--source", choices=("goal", "teleop", "mission", "browser"), default="goal")
    parser.add_argument("--world", default="walled")
    parser.add_argument("--only", default="", help="regular expression for the names of the processes")
    parser.add_argument("--load", type=int, default=0, help="busy processes beside the run")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(options.load)]
    try:
        with tempfile.TemporaryDirectory(prefix="lupin-bench-") as folder:
            os.environ["XDG_STATE_HOME"] = folder
            results = measure_all(options.only, signal.Signals[f"SIG{options.signal}"], options.source, options.world)
    finally:
        for process in busy:
            process.kill()
    limit_s = LIMIT_CONSOLE_REST_S if options.source == "browser" else LIMIT_REST_S[options.signal]
    failed = 0
    heads = [f"{head:>9s}" for head in ("at rest", "reported", "status", "replaced")]
    table = [f"{'process':12s} {' '.join(heads)}  why ({options.signal}, {options.source})"]
    for name, result in results.items():
        is_ok = result.within(limit_s)
        failed += not is_ok
        columns = (_seconds(result.at_rest_s), _seconds(result.reported_s), result.status_exit, _seconds(result.replaced_s))
        row = " ".join(f"{column:>9}" for column in columns)
        table.append(f"{name:12s} {row}  {result.why}{'' if is_ok else '  FAILED'}")
    print("\n".join(table), file=sys.stderr if options.json else sys.stdout)
    if options.json:
        print(json.dumps({name: asdict(result) for name, result in results.items()}))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
