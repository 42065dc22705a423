"""What happens when a process of a simulated run hangs or is killed while the robot drives, for every process.

    python -m bench.bench_hang [--signal STOP|KILL] [--source goal|teleop|mission|browser]
        [--only REGEX] [--load N] [--json]

Starts the stack with `lupin up`. For each process: let the robot drive, send the signal, and measure when the robot is at rest,
when `lupin status` reports the process, and when the process is replaced. Limits: at rest within 1.0 s (KILL: 0.35 s), reported
within 3 s. With `--source browser`, a client of the console drives, and only the console gets the signal (at rest within 0.5
s). Nothing replaces a stopped supervisor: it gets SIGCONT after it was reported.
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
# These are disturbed last: the run ends with the simulator, and the mission ends with its process.
LAST = ("mission", SUPERVISOR, "sim")
MOVING_M_S = 0.02
STANDSTILL_S = 0.3
WATCH_S, REPLACED_TIMEOUT_S = 3.5, 40.0
STATUS_ARGUMENTS = ("-m", "lupin_cli.app", "status", "--json", "--run")


@dataclass(frozen=True)
class Result:
    """What followed a signal, in seconds after it; None for what did not happen."""

    at_rest_s: float | None
    reported_s: float | None
    status_exit: int
    replaced_s: float | None
    consequence: str

    def within(self, limit_rest_s: float) -> bool:
        """Whether the robot came to rest in time, and `lupin status` reported the process in time and exited with an error."""
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
        """Return a process of the run's last state; {} if it is not there."""
        return next((stage for stage in self.run.state().get("stages", []) if stage["name"] == name), {})

    def drive(self, source: str) -> None:
        """Make the robot drive, and return once it moves."""
        self.sign = -self.sign
        if source == "teleop":
            self.zero_then_stream(graph.CMD_VEL_MANUAL)
        elif source == "goal":
            self.go()
        elif source == "browser":
            self._drive_from_console()
        self.until(lambda: self.speeds and self.speeds[-1][1] > 0.1, "motion", 60.0)

    def _drive_from_console(self) -> None:
        """Drive as a client of the console, in a thread, until the connection is lost."""
        console = read_description(self.run.path)
        assert console is not None
        browser, client = Browser(console.port), RosbridgeClient(console.rosbridge_port)
        browser.get("/")
        # The stop stays engaged if a console was lost before.
        self.until(lambda: browser.post("/_api/stop", engaged=False)["stop"] == [], "the release", 20.0)

        def stream() -> None:
            with suppress(ConnectionClosed, OSError):
                while True:
                    client.send("publish", topic=graph.CMD_VEL_MANUAL.name, msg={"linear": {"x": 0.3 * self.sign}})
                    time.sleep(0.05)

        client.send("publish", topic=graph.CMD_VEL_MANUAL.name, msg={})
        threading.Thread(target=stream, daemon=True).start()

    def disturb(self, name: str, number: signal.Signals, source: str) -> Result:
        """Send a signal to the process `name` while the robot drives, and watch what follows."""
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
        consequence = (
            f"{deaths[-1].get('status', '')}: {deaths[-1].get('consequence', '')}" if name != SUPERVISOR else "continued"
        )
        self._streams = dict.fromkeys(self._streams)
        return Result(_at_rest_s(list(self.speeds), began_s), reported_s, status_exit, replaced_s, consequence)


def _at_rest_s(speeds: list[tuple[float, float]], began_s: float) -> float | None:
    """Return the seconds until the base stood still for STANDSTILL_S, or until its last message."""
    rest_s: float | None = None
    for time_s, speed in speeds:
        if speed > MOVING_M_S:
            rest_s = None
        elif rest_s is None:
            rest_s = time_s
        elif time_s - rest_s > STANDSTILL_S:
            return max(0.0, rest_s - began_s)
    if rest_s is None and (not speeds or time.monotonic() - speeds[-1][0] > STANDSTILL_S):
        rest_s = speeds[-1][0] if speeds else began_s  # the simulation itself has stopped
    return None if rest_s is None else max(0.0, rest_s - began_s)


def measure_all(names: str, number: signal.Signals, source: str, world: str) -> dict[str, Result]:
    """Measure every process whose name matches the regular expression `names`; see `main` for the other arguments."""
    options = {"mission": ["--mission"], "browser": ["--web"]}
    arguments = ["--world", world, *options.get(source, [])]
    results: dict[str, Result] = {}
    run, rig = start_run(arguments), None
    try:
        all_names = [stage["name"] for stage in run.state()["stages"]] + [SUPERVISOR]
        ordered = [name for name in all_names if name not in LAST] + [name for name in LAST if name in all_names]
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
    """Measure the chosen processes and print a table; return 1 if a limit was missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--signal", choices=sorted(LIMIT_REST_S), default="STOP", help="send this signal")
    parser.add_argument(
        "--source", choices=("goal", "teleop", "mission", "browser"), default="goal", help="let this source drive"
    )
    parser.add_argument("--world", default="walled", help="drive in this world of `lupin up --world`")
    parser.add_argument("--only", default="", help="send signals only to processes whose name matches this regular expression")
    parser.add_argument("--load", type=int, default=0, help="run this many busy processes at the same time")
    parser.add_argument("--json", action="store_true", help="print one JSON line, and the table on standard error")
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
    headings = [f"{heading:>9s}" for heading in ("at rest", "reported", "status", "replaced")]
    table = [f"{'process':12s} {' '.join(headings)}  consequence ({options.signal}, {options.source})"]
    for name, result in results.items():
        is_ok = result.within(limit_s)
        failed += not is_ok
        columns = (_seconds(result.at_rest_s), _seconds(result.reported_s), result.status_exit, _seconds(result.replaced_s))
        row = " ".join(f"{column:>9}" for column in columns)
        table.append(f"{name:12s} {row}  {result.consequence}{'' if is_ok else '  FAILED'}")
    print("\n".join(table), file=sys.stderr if options.json else sys.stdout)
    if options.json:
        print(json.dumps({name: asdict(result) for name, result in results.items()}))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
