"""Complete missions with `lupin up --mission`: worlds `demo` and `random:1…20`, scored against the simulator's truth.

Limits of a mission: it is DONE, every reachable tag is read, no collision, median tag error ≤ 5 cm, trajectory RMSE ≤ 5 cm. At
least 19 of 20 missions should be within them. Further limits, for the figures that are only printed: real-time factor ≥ 1,
memory of all processes ≤ 1.2 GB, drivable after ≤ 6 s, READY after ≤ 12 s.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

TIMEOUT_S = 2400.0
LIMIT_SHARE = 0.95


def run_mission(world: str) -> dict[str, Any]:
    """Run one mission; return the object printed by `lupin up --json`, with exit status and start-up times."""
    command = [sys.executable, "-m", "lupin_cli.app", "up", "--mission", "--headless", "--json", "--world", world]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return {"world": world, "state": "TIMEOUT"}
    result: dict[str, Any] = json.loads(done.stdout) if done.stdout.strip() else {"state": done.stderr[-200:]}
    result.update(world=world, exit_status=done.returncode)
    if result.get("report"):
        stored = json.loads((Path(result["report"]).parents[1] / "result.json").read_text())
        result.update(drivable_s=stored["outcome"]["drivable_s"], ready_s=stored["outcome"]["ready_s"])
    return result


def meets_limits(result: dict[str, Any]) -> bool:
    """Return whether a result is within the limits of a mission."""
    return bool(
        result.get("state") == "DONE"
        and result["tags_read"] == result["tags_reachable"]
        and result["collisions"] == 0
        and result["tag_error_median_m"] <= 0.05
        and result["trajectory_rmse_m"] <= 0.05
    )


def main() -> int:
    """Run a mission in every world and print its scores; return 1 if fewer than 19 of 20 missions are within the limits."""
    parser = argparse.ArgumentParser(description=__doc__)
    worlds = ["demo", *(f"random:{seed}" for seed in range(1, 21))]
    parser.add_argument("worlds", nargs="*", default=worlds, help="worlds to run; default: demo and random:1 to 20")
    results = []
    columns = (
        "tags_read tags_reachable collisions trajectory_rmse_m tag_error_median_m real_time_factor memory_mb drivable_s ready_s"
    )
    print(f"{'world':12s} {'state':9s} {columns}", flush=True)
    for world in parser.parse_args().worlds:
        result = run_mission(world)
        results.append(result)
        cells = "  ".join(
            f"{value:.3f}" if isinstance(value := result.get(name), float) else str(value) for name in columns.split()
        )
        print(f"{world:12s} {result['state']:9s} {cells}  {'ok' if meets_limits(result) else 'MISSED'}", flush=True)
    count = sum(map(meets_limits, results))
    print(json.dumps({"within_limits": count, "missions": len(results), "limit": "19 of 20", "results": results}))
    return 0 if count >= LIMIT_SHARE * len(results) else 1


if __name__ == "__main__":
    sys.exit(main())
