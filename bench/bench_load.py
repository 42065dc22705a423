"""Missions one after the other on a busy machine, on which no process hangs: none may be replaced.

    python -m bench.bench_load [--load 10] [--hours 1] [--world demo]

Runs `lupin up --mission` again and again, beside busy loops. A busy machine is not a hang: each process that the supervisor
kills or restarts counts as replaced wrongly, since nothing here disturbs a process. Prints one JSON line; exits with 1 if a
process was replaced wrongly, or if no mission started.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

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
        print(f"mission {started}: {outcome.get('sentence')}; replaced: {replaced}", file=sys.stderr, flush=True)
        if not outcome:
            break
    return {"missions_started": started, "missions_done": done, "replaced_wrongly": len(replaced), "replaced": replaced}


def main() -> int:
    """Run missions beside busy loops and print a JSON line; return 1 if a process was replaced, or no mission started."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--load", type=int, default=10, help="run this many busy processes at the same time")
    parser.add_argument("--hours", type=float, default=1.0, help="run missions for this long")
    parser.add_argument("--world", default="demo", help="drive in this world of `lupin up --world`")
    options = parser.parse_args()
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(options.load)]
    try:
        with tempfile.TemporaryDirectory(prefix="lupin-bench-") as folder:
            os.environ["XDG_STATE_HOME"] = folder
            result = run_missions(options.world, options.hours * 3600.0)
    finally:
        for process in busy:
            process.kill()
    print(json.dumps({"load": options.load, "hours": options.hours, "cores": os.cpu_count(), **result}), flush=True)
    return 1 if result["replaced_wrongly"] or not result["missions_started"] else 0


if __name__ == "__main__":
    sys.exit(main())
