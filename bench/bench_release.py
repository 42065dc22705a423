"""How far the robot moves after the e-stop's release without a newer command, for every source of motion.

    python -m bench.bench_release [--press 6] [--watch 6] [--world walled] [--only REGEX] [--json]

Starts the stack with `lupin up`. For each source: start it, press the simulated button while the robot moves, release it, and
watch; then give a newer command, which must move the robot. The base is measured by the simulator's true trajectory, arm and
gripper by their joint states. Limits: 1 mm and 0.02 rad.
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
    """Measure the cases of these names on one run."""
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
    """Print the table; return 1 if a limit was missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--press", type=float, default=6.0, help="seconds for which the button is pressed")
    parser.add_argument("--watch", type=float, default=6.0, help="seconds after the release")
    parser.add_argument("--world", default="walled")
    parser.add_argument("--only", default="", help="regular expression for the names of the sources")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    names = [case.name for case in CASES if re.search(options.only, case.name)]
    with tempfile.TemporaryDirectory(prefix="lupin-bench-") as folder:
        os.environ["XDG_CONFIG_HOME"] = folder  # the arm library
        results = measure(options.world, names, options.press, options.watch)
    failed = 0
    if not options.json:
        print(f"{'source':52s} {'base, mm':>9s} {'joints, rad':>12s}  newer command moves")
    for name, result in results.items():
        ok = result.base_m <= LIMIT_M and result.joints_rad <= LIMIT_RAD and result.newer_moves
        failed += not ok
        if not options.json:
            moves = "yes" if result.newer_moves else "no"
            print(f"{name:52s} {result.base_m * 1e3:9.2f} {result.joints_rad:12.4f}  {moves}{'' if ok else '  FAILED'}")
    print(json.dumps({name: vars(result) for name, result in results.items()}), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
