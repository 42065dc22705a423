"""How far the robot still moves when the e-stop is released and no newer command comes, for every source of motion.

    python -m bench.bench_release [--press 6] [--watch 6] [--world walled] [--only REGEX] [--json]

Starts the stack with `lupin up`. For each source: start it, press the simulated button while the robot moves, release it, and
watch; then give a newer command, which must move the robot. The motion of the base is read from the simulator's true
trajectory, that of arm and gripper from their joint states. Limits: 1 mm and 0.02 rad.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import tempfile

from bench.detached_run import start_run, stop_run
from tests.support.release_cases import CASES
from tests.support.release_rig import Measured, ReleaseRig

LIMIT_M, LIMIT_RAD = 0.001, 0.02


def measure(world: str, names: list[str], press_s: float, watch_s: float) -> dict[str, Measured]:
    """Measure the cases with these names in one run of the stack."""
    run = start_run(["--world", world, "--no-record", "--no-cameras"])
    rig = None
    try:
        rig = ReleaseRig(run.path)
        results: dict[str, Measured] = {}
        for case in CASES:
            if case.name in names:
                results[case.name] = rig.measure(case, press_s, watch_s)
                print(case.name, results[case.name], file=sys.stderr, flush=True)
        return results
    finally:
        if rig is not None:
            rig.close()
        stop_run(run)


def main() -> int:
    """Measure the chosen sources and print a table; return 1 if a limit was missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--press", type=float, default=6.0, help="hold the button for this many seconds")
    parser.add_argument("--watch", type=float, default=6.0, help="watch for this many seconds after the release")
    parser.add_argument("--world", default="walled", help="drive in this world of `lupin up --world`")
    parser.add_argument("--only", default="", help="measure only sources whose name matches this regular expression")
    parser.add_argument("--json", action="store_true", help="print only the JSON line")
    options = parser.parse_args()
    names = [case.name for case in CASES if re.search(options.only, case.name)]
    with tempfile.TemporaryDirectory(prefix="lupin-bench-") as folder:
        os.environ["XDG_CONFIG_HOME"] = folder  # the arm library is stored there
        results = measure(options.world, names, options.press, options.watch)
    failed = 0
    if not options.json:
        print(f"{'source':52s} {'base, mm':>9s} {'joints, rad':>12s}  newer command moves")
    for name, result in results.items():
        ok = result.base_m <= LIMIT_M and result.joints_rad <= LIMIT_RAD and result.newer_command_moves
        failed += not ok
        if not options.json:
            moves = "yes" if result.newer_command_moves else "no"
            print(f"{name:52s} {result.base_m * 1e3:9.2f} {result.joints_rad:12.4f}  {moves}{'' if ok else '  FAILED'}")
    print(json.dumps({name: vars(result) for name, result in results.items()}), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
