"""How far the robot still moves when the e-stop is released and no newer command comes, for every source of motion.

Starts the stack with `lupin up`. For each source: start it, press the simulated button while the robot moves, release it, and
watch; then give a newer command, which must move the robot. `--combinations` starts several sources at once: every choice of
mission, arm replay, /goal_pose, goal of a client and held stick. With `--hang`, a process gets SIGSTOP, or SIGKILL, just before
the press. The motion of the base is read from the simulator's true trajectory, that of arm and gripper from their joint states.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import tempfile
from contextlib import closing
from typing import Annotated

from bench.detached_run import detached_run
from bench.runner import Figures, Only, World, benchmark, note
from tests.support.hang import Hang
from tests.support.motion_sources import COMBINATIONS, SOURCES, MotionSource
from tests.support.release_rig import Measured, ReleaseRig


def measure(world: str, sources: list[MotionSource], press_s: float, watch_s: float, hang: Hang | None) -> dict[str, Measured]:
    """Measure these sources in one run of the stack."""
    results: dict[str, Measured] = {}
    with detached_run(["--world", world, "--no-record", "--no-cameras"]) as run, closing(ReleaseRig(run.path)) as rig:
        for source in sources:
            results[source.name] = rig.measure(source, press_s, watch_s, hang)
            note(source.name, vars(results[source.name]))
    return results


@benchmark(at_most={"base_m": 0.001, "joints_rad": 0.02, "body.*.joints_rest_s": 2.0})
def main(
    press: Annotated[float, "hold the button for this many seconds"] = 6.0,
    watch: Annotated[float, "watch for this many seconds after the release"] = 6.0,
    world: World = "walled",
    only: Only = "",
    combinations: Annotated[bool, "measure several sources at once"] = False,
    hang: Annotated[str, "send SIGSTOP to this process just before the press", ("", "estop", "drive", "body")] = "",
    kill: Annotated[bool, "send SIGKILL instead"] = False,
) -> Figures:
    """Measure the chosen sources; a newer command must move the robot."""
    sources = [source for source in (COMBINATIONS if combinations else SOURCES) if re.search(only, source.name)]
    stopped = Hang(hang, signal.SIGKILL if kill else signal.SIGSTOP) if hang else None
    with tempfile.TemporaryDirectory(prefix="lupin-bench-") as folder:
        os.environ["XDG_CONFIG_HOME"] = folder  # the arm library is stored there
        results = measure(world, sources, press, watch, stopped)
    return {hang or "sources": {name: {**vars(each), "met": each.newer_command_moves} for name, each in results.items()}}


if __name__ == "__main__":
    sys.exit(main())
