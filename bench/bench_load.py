"""Missions one after the other on a busy machine, on which no process hangs: none may be replaced.

Runs `lupin up --mission` again and again, beside busy loops. A busy machine is not a hang: each process that the supervisor
kills or restarts counts as replaced wrongly, since nothing here disturbs a process.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from typing import Annotated, Any

from bench.processes import busy_processes
from bench.runner import Figures, Load, World, benchmark, note
from lupin_runtime.stack.runs import all_runs

END_TIMEOUT_S = 180.0


def run_mission(world: str, timeout_s: float) -> dict[str, Any]:
    """Run one mission, at most for `timeout_s`; return the outcome that its run has written, {} if there is none."""
    command = [sys.executable, "-m", "lupin_cli.app", "up", "--mission", "--headless", "--json", "--world", world]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        process.communicate(timeout=timeout_s)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=END_TIMEOUT_S)
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    outcome: dict[str, Any] = all_runs()[-1].state().get("outcome", {})
    return outcome


def run_missions(world: str, duration_s: float) -> dict[str, Any]:
    """Run missions for this long; return how many were started and done, and the processes that were replaced."""
    deadline = time.monotonic() + duration_s
    started, done, replaced = 0, 0, []
    while (left_s := deadline - time.monotonic()) > 0.0:
        outcome = run_mission(world, left_s)
        started += outcome.get("ready_s") is not None
        done += outcome.get("state") == "DONE"
        replaced += [f"{death['stage']} {death['status']}" for death in outcome.get("deaths", [])]
        note(f"mission {started}: {outcome.get('sentence')}; replaced: {replaced}")
        if not outcome:
            break
    return {"missions_started": started, "missions_done": done, "replaced_wrongly": len(replaced), "replaced": replaced}


@benchmark(at_most={"replaced_wrongly": 0}, at_least={"missions_started": 1}, long=True)
def main(load: Load = 10, hours: Annotated[float, "run missions for this long"] = 1.0, world: World = "demo") -> Figures:
    """Run missions beside busy loops."""
    with busy_processes(load), tempfile.TemporaryDirectory(prefix="lupin-bench-") as folder:
        os.environ["XDG_STATE_HOME"] = folder
        result = run_missions(world, hours * 3600.0)
    return {"load": load, "hours": hours, "cores": os.cpu_count(), **result}


if __name__ == "__main__":
    sys.exit(main())
