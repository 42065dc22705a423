"""Complete missions with `lupin up --mission`: worlds `demo` and `random:1…20`, scored against the simulator's truth.

Limits of a mission: it is DONE, every reachable tag is read, no collision, median tag error ≤ 5 cm, trajectory RMSE ≤ 5 cm. At
least 19 of 20 missions should be within them. Further limits, for the figures that are only printed: real-time factor ≥ 1,
memory of all processes ≤ 1.2 GB, drivable after ≤ 6 s, READY after ≤ 12 s.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

from bench.runner import Figures, benchmark, note

TIMEOUT_S = 2400.0
WORLDS = ("demo", *(f"random:{seed}" for seed in range(1, 21)))
SHOWN = (
    *("state", "tags_read", "tags_reachable", "collisions", "trajectory_rmse_m", "tag_error_median_m", "real_time_factor"),
    *("memory_mb", "drivable_s", "ready_s"),
)


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


@benchmark(at_least={"share_within_limits": 0.95}, long=True)
def main(*worlds: Annotated[str, "worlds to drive in; default: demo and random:1 to 20"]) -> Figures:
    """Run a mission in every world."""
    missions: dict[str, dict[str, Any]] = {}
    within_limits = 0
    for world in worlds or WORLDS:
        result = run_mission(world)
        is_within = meets_limits(result)
        within_limits += is_within
        missions[world] = {**{name: result.get(name) for name in SHOWN}, "within_limits": is_within}
        note(world, missions[world])
    return {"missions": missions, "within_limits": within_limits, "share_within_limits": within_limits / len(missions)}


if __name__ == "__main__":
    sys.exit(main())
