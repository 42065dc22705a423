"""What happens when a process of a simulated run hangs or is killed while the robot drives, for every process.

Starts the stack with `lupin up`. For each process: let the robot drive, send the signal, and measure when the robot is at rest,
when `lupin status` names the process and exits with an error, and when the process is replaced, unless the run or the mission
ends with it. A mission must then go on, or end with a reason. With `--source browser`, a client of the console drives, and only
the console gets the signal. Nothing replaces the supervisor: stopped, it gets SIGCONT after it was named; killed, it ends the
run, so it is measured last, in a run of its own.
"""

from __future__ import annotations

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
from typing import Annotated, Any

from websockets.exceptions import ConnectionClosed

from bench.detached_run import start_run, stop_run
from bench.processes import busy_processes
from bench.runner import Figures, Load, Only, World, benchmark, note
from lupin_runtime import graph
from lupin_runtime.console.description import read_description
from lupin_runtime.stack.alarms import alarms
from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.table import TABLE
from tests.support.console_browser import Browser
from tests.support.release_rig import ReleaseRig
from tests.support.rosbridge_client import RosbridgeClient

SUPERVISOR, CONSOLE = "supervisor", "console"
# These are disturbed last: the run ends with the simulator, or with a killed supervisor, and the mission with its process.
LAST, LAST_WITH_KILL = ("mission", SUPERVISOR, "sim"), ("mission", "sim", SUPERVISOR)
MOVING_M_S, DRIVING_M_S = 0.02, 0.1
STANDSTILL_S = 0.3
WATCH_S, REPLACED_TIMEOUT_S = 3.5, 40.0
MISSION_TIMEOUT_S = 90.0  # until a mission drives again: it may wait for the map and plan a new path
ENDS_WITH = {row.name: row.on_death for row in TABLE if row.on_death != "restart"}
GOES_ON = "goes on"
STATUS_ARGUMENTS = ("-m", "lupin_cli.app", "status", "--json", "--run")


@dataclass(frozen=True)
class Result:
    """What followed a signal, in seconds after it; None for what did not happen.

    `mission` is GOES_ON, why the mission ended, or "" if it did neither; None without a mission.
    """

    at_rest_s: float | None
    reported_s: float | None
    status_exit: int
    replaced_s: float | None
    consequence: str
    mission: str | None = None


def must_be_replaced(name: str, source: str) -> bool:
    """Return whether the supervisor must replace a process; some end the run or the mission instead."""
    return name != SUPERVISOR and not (ENDS_WITH.get(name) == "run" or (ENDS_WITH.get(name) == "mission" == source))


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

    def process_state(self, name: str) -> dict[str, Any]:
        """Return a process in the run's last state, whose list of processes is called `stages`; {} if it is not there."""
        return next((process for process in self.run.state().get("stages", []) if process["name"] == name), {})

    def drive(self, source: str) -> None:
        """Make the robot drive, and return once it moves."""
        self.sign = -self.sign
        if source == "teleop":
            self.zero_then_stream(graph.CMD_VEL_MANUAL)
        elif source == "goal":
            self.go()
        elif source == "browser":
            self._drive_from_console()
        self.until(lambda: self.speeds and self.speeds[-1][1] > DRIVING_M_S, "motion", 60.0)

    def _drive_from_console(self) -> None:
        """Drive as a client of the console, in a thread, until the connection is lost."""
        console = read_description(self.run.path)
        assert console is not None
        browser, client = Browser(console.port), RosbridgeClient(console.rosbridge_port)
        browser.get("/")
        # The stop stays engaged if a console was lost before.
        self.until(lambda: browser.post("/_api/stop", engaged=False)["stop"] == [], "the stop to be released", 20.0)

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
        pid = self.run.info()["pid"] if name == SUPERVISOR else self.process_state(name)["pid"]
        self.speeds.clear()
        began_s = time.monotonic()
        os.kill(pid, number)
        reported_s, status_exit, replaced_s = None, 0, None
        while (elapsed_s := time.monotonic() - began_s) < REPLACED_TIMEOUT_S:
            process = self.process_state(name)
            if reported_s is None and self._is_reported(name):
                reported_s = elapsed_s
                status_exit = self._status_exit(name)
            if name == SUPERVISOR and reported_s is not None and elapsed_s > WATCH_S:
                break
            if replaced_s is None and process.get("pid") not in (pid, None) and process.get("phase") == "up":
                replaced_s = elapsed_s
            if elapsed_s > WATCH_S and (replaced_s is not None or not self.run.is_live()):
                break
            time.sleep(0.02)
        at_rest_s = _at_rest_s(list(self.speeds), began_s)
        if name == SUPERVISOR and number == signal.SIGSTOP:
            os.kill(pid, signal.SIGCONT)
        mission = self._mission_outcome() if source == "mission" else None
        self._streams = dict.fromkeys(self._streams)
        return Result(at_rest_s, reported_s, status_exit, replaced_s, self._consequence(name), mission)

    def _is_reported(self, name: str) -> bool:
        """Return whether the run's state names the process; a run without a supervisor is named by its end."""
        state = self.run.state()
        if name == SUPERVISOR:
            return not self.run.is_live() or any(alarm.startswith(f"the {SUPERVISOR} ") for alarm in alarms(state))
        return any(alarm.startswith(f"{name} ") for alarm in alarms(state)) or self.process_state(name).get("phase") != "up"

    def _status_exit(self, name: str) -> int:
        """Return the exit status of `lupin status`; 0 also if it names another process instead."""
        command = [sys.executable, *STATUS_ARGUMENTS, self.run.id]
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=30)
        shown = json.loads(done.stdout)
        names = [each["name"] for each in shown.get("stages", []) if each["phase"] != "up" or each.get("trouble")]
        if any(alarm.startswith(f"the {SUPERVISOR} ") for alarm in shown.get("alarms", [])) or "error" in shown:
            names.append(SUPERVISOR)
        return done.returncode if name in names or not self.run.is_live() else 0

    def _consequence(self, name: str) -> str:
        if name == SUPERVISOR:
            return "continued" if self.run.is_live() else "the run ended"
        state = self.run.state()
        deaths = state.get("deaths") or state.get("outcome", {}).get("deaths") or [{}]
        return f"{deaths[-1].get('status', '')}: {deaths[-1].get('consequence', '')}"

    def _mission_outcome(self) -> str:
        """Wait until the mission drives on, or ends; return GOES_ON, the reason, or "" if neither happens."""
        deadline = time.monotonic() + MISSION_TIMEOUT_S
        self.speeds.clear()
        while time.monotonic() < deadline and self.run.is_live():
            mission = self.run.state().get("mission") or {}
            if mission.get("lifecycle_state") in ("DONE", "FAULT") or mission.get("paused"):
                return f"{mission['lifecycle_state']}: {mission.get('last_event') or mission.get('last_error') or 'done'}"
            if any(speed > DRIVING_M_S for _, speed in list(self.speeds)):
                return GOES_ON
            time.sleep(0.1)
        if self.run.is_live():
            return ""
        # A run whose supervisor was killed writes no outcome, but anybody can see that it has ended.
        return str(self.run.state().get("outcome", {}).get("sentence", "the run ended with its supervisor"))


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
        all_names = [process["name"] for process in run.state()["stages"]] + [SUPERVISOR]
        last = LAST if number == signal.SIGSTOP else LAST_WITH_KILL
        ordered = [name for name in all_names if name not in last] + [name for name in last if name in all_names]
        for name in ordered:
            if not re.search(names, name) or (source == "browser" and name != CONSOLE):
                continue
            if rig is None or not run.is_live():
                if rig is not None:
                    rig.close()
                run = run if run.is_live() else start_run(arguments)
                rig = HangRig(run)
            results[name] = rig.disturb(name, number, source)
            note(name, asdict(results[name]))
            time.sleep(2.0)  # until the successor takes part in the run
        return results
    finally:
        if rig is not None:
            rig.close()
        if run.is_live():
            stop_run(run)


@benchmark(
    at_most={"STOP.*.at_rest_s": 1.0, "KILL.*.at_rest_s": 0.35, "browser.*.at_rest_s": 0.5, "reported_s": 3.0},
    at_least={"status_exit": 1},
)
def main(
    signal_: Annotated[str, "send this signal", ("KILL", "STOP")] = "STOP",
    source: Annotated[str, "let this source drive", ("goal", "teleop", "mission", "browser")] = "goal",
    world: World = "walled",
    only: Only = "",
    load: Load = 0,
) -> Figures:
    """Measure the chosen processes."""
    with busy_processes(load), tempfile.TemporaryDirectory(prefix="lupin-bench-") as folder:
        os.environ["XDG_STATE_HOME"] = folder
        results = measure_all(only, signal.Signals[f"SIG{signal_}"], source, world)
    rows = {}
    for name, result in results.items():
        went_on = result.replaced_s is not None or not must_be_replaced(name, source)
        rows[name] = {**asdict(result), "met": went_on and result.mission != ""}
    return {signal_: {source: rows}}


if __name__ == "__main__":
    sys.exit(main())
