"""The robot's own half of the stack, as a service: `python -m lupin_runtime.stack.onboard`.

Drive bus, e-stop, arm, gripper and strip, in the environment it is started in. It says READY to systemd when all of them are
up, and what it waits for until then. Exit status: 0 told to stop, 1 a process never came up or was given up; systemd starts
it again, which also mends what started before the network interface it needs.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from typing import TYPE_CHECKING

from lupin_runtime.ros.notify import Notifier
from lupin_runtime.stack.dds import GRAPH_VARIABLES
from lupin_runtime.stack.runs import Run, RunError, create_run
from lupin_runtime.stack.supervisor import Supervisor
from lupin_runtime.stack.table import ONBOARD, Options

if TYPE_CHECKING:
    from lupin_runtime.stack.watch import GraphWatch

STEP_S = 0.1
STATE_PERIOD_S = 2.0


def onboard_options() -> Options:
    """What runs on the robot itself; all else is the laptop's."""
    off = dict.fromkeys(("slam", "nav2", "twin", "perception", "yolo", "mission", "record", "cameras"), False)
    return Options(target=ONBOARD, **off)  # type: ignore[arg-type]


def trouble(supervisor: Supervisor) -> str:
    """Why this half cannot go on, in words; empty while it can."""
    for stage in supervisor.stalled():
        waits = "; ".join(supervisor.waiting_for(stage))
        return f"{stage.row.name} never came up: {waits}" if waits else f"{stage.row.name}: {stage.why}"
    return ""


def progress(supervisor: Supervisor) -> str:
    """One line of what is up and what is waited for."""
    waiting = [f"{s.row.name} ({'; '.join(supervisor.waiting_for(s))})" for s in supervisor.stages if supervisor.waiting_for(s)]
    up = [stage.row.name for stage in supervisor.stages if supervisor.all_up([stage.row.name])]
    return f"up: {', '.join(up) or 'nothing yet'}" + (f"; waiting for: {', '.join(waiting)}" if waiting else "")


def main() -> int:
    """Run until told to stop."""
    notifier = Notifier()
    stop: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda number, _: stop.append(number))
    try:
        run, _lock = create_run()
    except RunError as error:
        print(error, file=sys.stderr)
        return 1
    graph = {name: os.environ[name] for name in GRAPH_VARIABLES if name in os.environ}
    run.write_info(
        {"id": run.id, "pid": os.getpid(), "started": time.time(), "environment": graph, "options": {"target": ONBOARD}}
    )
    print(f"onboard: {' '.join(f'{name}={value}' for name, value in graph.items()) or 'no ROS variables are set'}", flush=True)

    from lupin_runtime.stack.watch import GraphWatch

    # No rates: a subscription to a map would pull it over the radio link for nobody to look at.
    watch = GraphWatch(rated=())
    options = onboard_options().in_folder(run.path)
    supervisor = Supervisor(options, run, dict(os.environ), watch, own_output=True)
    try:
        return _follow(supervisor, watch, notifier, run, stop)
    finally:
        notifier.stopping()
        supervisor.stop()
        watch.close()


def _follow(supervisor: Supervisor, watch: GraphWatch, notifier: Notifier, run: Run, stop: list[int]) -> int:
    said_ready, state_due_s, deaths = False, 0.0, 0
    while not stop:
        watch.spin(STEP_S)
        supervisor.step()
        notifier.alive()
        for death in supervisor.deaths[deaths:]:
            print(f"{death.stage} {death.status}: {death.consequence}", file=sys.stderr, flush=True)
        deaths = len(supervisor.deaths)
        why = trouble(supervisor)
        if why:
            print(why, file=sys.stderr, flush=True)
            return 1
        if supervisor.all_up() and not said_ready:
            said_ready = True
            print(progress(supervisor), flush=True)
            notifier.ready()
        notifier.status(progress(supervisor))
        if time.monotonic() >= state_due_s:
            state_due_s = time.monotonic() + STATE_PERIOD_S
            run.write_state({**supervisor.snapshot(), "id": run.id})
    return 0


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    sys.stderr.flush()
    # Interpreter shutdown after DDS is slow and may abort; everything worth keeping is written by now.
    os._exit(status)
