"""How far the robot still moves when the e-stop is released and no newer command comes, for every source of motion.

    python -m bench.bench_release [--press 6] [--watch 6] [--world walled] [--only REGEX] [--combinations]
        [--hang estop|drive|body [--kill]] [--json]

Starts the stack with `lupin up`. For each source: start it, press the simulated button while the robot moves, release it, and
watch; then give a newer command, which must move the robot. `--combinations` starts several sources at once: every choice of
mission, arm replay, /goal_pose, goal of a client and held stick. With `--hang`, a process gets SIGSTOP, or SIGKILL, just before
the press. The motion of the base is read from the simulator's true trajectory, that of arm and gripper from their joint states.
Limits: 1 mm and 0.02 rad; with `--hang body`, the joints are at rest within 2 s.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import sys
import tempfile

from bench.detached_run import start_run, stop_run
from tests.support.hang import Hang
from tests.support.motion_sources import COMBINATIONS, SOURCES, MotionSource
from tests.support.release_rig import Measured, ReleaseRig

LIMIT_M, LIMIT_RAD, LIMIT_JOINTS_REST_S = 0.001, 0.02, 2.0


def measure(world: str, sources: list[MotionSource], press_s: float, watch_s: float, hang: Hang | None) -> dict[str, Measured]:
    """Measure these sources in one run of the stack."""
    run = start_run(["--world", world, "--no-record", "--no-cameras"])
    rig = None
    try:
        rig = ReleaseRig(run.path)
        results: dict[str, Measured] = {}
        for source in sources:
            results[source.name] = rig.measure(source, press_s, watch_s, hang)
            print(source.name, results[source.name], file=sys.stderr, flush=True)
        return results
    finally:
        if rig is not None:
            rig.close()
        stop_run(run)


def main() -> int:
    """Measure the chosen sources and print a table; return 1 if one exceeds a limit, or a newer command moves nothing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--press", type=float, default=6.0, help="hold the button for this many seconds")
    parser.add_argument("--watch", type=float, default=6.0, help="watch for this many seconds after the release")
    parser.add_argument("--world", default="walled", help="drive in this world of `lupin up --world`")
    parser.add_argument("--only", default="", help="measure only sources whose name matches this regular expression")
    parser.add_argument("--combinations", action="store_true", help="measure several sources at once")
    parser.add_argument("--hang", choices=("estop", "drive", "body"), help="send SIGSTOP to this process just before the press")
    parser.add_argument("--kill", action="store_true", help="send SIGKILL instead")
    parser.add_argument("--json", action="store_true", help="print only the JSON line")
    options = parser.parse_args()
    chosen = COMBINATIONS if options.combinations else SOURCES
    sources = [source for source in chosen if re.search(options.only, source.name)]
    hang = Hang(options.hang, signal.SIGKILL if options.kill else signal.SIGSTOP) if options.hang else None
    with tempfile.TemporaryDirectory(prefix="lupin-bench-") as folder:
        os.environ["XDG_CONFIG_HOME"] = folder  # the arm library is stored there
        results = measure(options.world, sources, options.press, options.watch, hang)
    failed = 0
    if not options.json:
        print(f"{'source':52s} {'base, mm':>9s} {'joints, rad':>12s} {'at rest, s':>11s}  newer command moves")
    for name, result in results.items():
        ok = result.base_m <= LIMIT_M and result.joints_rad <= LIMIT_RAD and result.newer_command_moves
        ok = ok and (options.hang != "body" or result.joints_rest_s <= LIMIT_JOINTS_REST_S)
        failed += not ok
        if not options.json:
            moves = "yes" if result.newer_command_moves else "no"
            columns = f"{result.base_m * 1e3:9.2f} {result.joints_rad:12.4f} {result.joints_rest_s:11.2f}"
            print(f"{name:52s} {columns}  {moves}{'' if ok else '  FAILED'}")
    print(json.dumps({name: vars(result) for name, result in results.items()}), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
