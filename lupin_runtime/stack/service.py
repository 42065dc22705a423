"""Runs a target's processes as a systemd service on the robot.

It notifies systemd of READY when all processes are up, and until then reports the conditions that it waits for. Exit status: 0
stopped by a signal, 1 a process did not come up or was given up. systemd then starts the service again, which also helps if it
was started before its network interface.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING

from lupin_runtime.exit_codes import FAILURE, SUCCESS
from lupin_runtime.stack.dds import GRAPH_VARIABLES
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.retention import remove_old_runs
from lupin_runtime.stack.runs import Run, RunError, create_run, runs_directory
from lupin_runtime.stack.sd_notify import Notifier
from lupin_runtime.stack.stage import LIVENESS_FAILED
from lupin_runtime.stack.state_file import StateFile, unwritable
from lupin_runtime.stack.supervisor import NothingObserved, Supervisor
from lupin_runtime.stack.usage import start_ticks

if TYPE_CHECKING:
    from lupin_runtime.stack.graph_monitor import GraphMonitor

STEP_S = 0.1  # until the service is ready; then a step costs more than it finds
READY_STEP_S = 0.25
STATE_PERIOD_S = 1.0
# To read the memory of all processes takes 8 ms of an x86 core, and systemd limits that of the unit at any time.
USAGE_PERIOD_S = 10.0
RETRY_OPTIONAL_S = 60.0
MAX_RUNS = 5  # they are in memory


def failure(supervisor: Supervisor) -> str:
    """Return why the service cannot continue, or an empty text."""
    if LIVENESS_FAILED in supervisor.deaths:
        return f"{LIVENESS_FAILED.stage} {LIVENESS_FAILED.status}"
    for stage in supervisor.stalled():
        waits = "; ".join(supervisor.waiting_for(stage))
        return f"{stage.row.name} did not come up: {waits}" if waits else f"{stage.row.name}: {stage.why}"
    return ""


def progress(supervisor: Supervisor) -> str:
    """Return one line that lists the processes that are up and the conditions that the others wait for."""
    waiting = [f"{s.row.name} ({'; '.join(supervisor.waiting_for(s))})" for s in supervisor.stages if supervisor.waiting_for(s)]
    up = [stage.row.name for stage in supervisor.stages if supervisor.all_up([stage.row.name])]
    return f"up: {', '.join(up) or 'nothing yet'}" + (f"; waiting for: {', '.join(waiting)}" if waiting else "")


def serve(chosen: Options) -> int:
    """Run the processes of a target until a signal arrives or a process fails for good; return the exit status.

    The systemd watchdog is notified while all `watched` processes respond.
    """
    notifier = Notifier()
    stop: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda number, _: stop.append(number))
    graph = {name: os.environ[name] for name in GRAPH_VARIABLES if name in os.environ}
    run = _open_run(chosen, graph)
    variables = " ".join(f"{name}={value}" for name, value in graph.items()) or "no ROS variables are set"
    print(f"{chosen.target}: {variables}", flush=True)

    supervisor = Supervisor(
        chosen.in_folder(run.path),
        run,
        dict(os.environ),
        NothingObserved(),
        own_output=True,
        usage_period_s=USAGE_PERIOD_S,
        retry_optional_s=RETRY_OPTIONAL_S,
    )
    monitor: GraphMonitor | None = None
    try:
        supervisor.step()  # processes that wait for nothing start meanwhile
        from lupin_runtime.stack.graph_monitor import GraphMonitor

        # No rates are measured: a subscription to the map would transfer it over the wireless link for no use.
        supervisor.monitor = monitor = GraphMonitor(rated=())
        return _supervise(supervisor, monitor, notifier, run, stop)
    finally:
        notifier.stopping()
        supervisor.stop()
        if monitor is not None:
            monitor.close()


def _open_run(chosen: Options, graph: Mapping[str, str]) -> Run:
    """Create the service's run, for `lupin status` and the doctor. Without space for it, the processes run all the same."""
    try:
        run, _lock = create_run()
    except RunError as error:
        _report(f"{error}; until then, lupin status shows nothing")
        return Run(runs_directory() / "none")
    try:
        remove_old_runs(MAX_RUNS)
        run.write_info(
            {
                "id": run.id,
                "pid": os.getpid(),
                "start_ticks": start_ticks(os.getpid()),
                "started": time.time(),
                "environment": dict(graph),
                "options": {"target": chosen.target},
            }
        )
    except OSError as error:
        _report(unwritable(run, error))
    return run


def _report(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _supervise(supervisor: Supervisor, monitor: GraphMonitor, notifier: Notifier, run: Run, stop: list[int]) -> int:
    watched = [stage.row.name for stage in supervisor.stages if stage.row.watched]
    state_file = StateFile(run, _report)
    notified_ready, state_due_s, deaths = False, 0.0, 0
    while not stop:
        monitor.spin(READY_STEP_S if notified_ready else STEP_S)
        supervisor.step()
        if all(supervisor.liveness.responds(name) for name in watched) or not notified_ready:
            notifier.alive()
        for death in supervisor.deaths[deaths:]:
            _report(f"{death.stage} {death.status}: {death.consequence}")
        deaths = len(supervisor.deaths)
        why = failure(supervisor)
        if why:
            _report(why)
            return FAILURE
        if supervisor.all_up() and not notified_ready:
            notified_ready = True
            print(progress(supervisor), flush=True)
            notifier.ready()
        notifier.status(progress(supervisor))
        if time.monotonic() >= state_due_s:
            state_due_s = time.monotonic() + STATE_PERIOD_S
            state_file.write({**supervisor.snapshot(), "id": run.id, "alarms": list(monitor.alarms)})
    return SUCCESS
