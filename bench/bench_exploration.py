"""Explorations in the mission simulator: tags read, distance driven, simulated time.

The peer is a mission that explores frontiers only. In every world, Lupin must read every reachable tag.
"""

from __future__ import annotations

import sys
from typing import Annotated, Any

from bench.runner import Figures, benchmark, note
from tests.support.mission_simulator import simulate_exploration

WORLDS = ("demo", *(f"random:{seed}" for seed in range(1, 21)), "course", "walled")


@benchmark(at_most={"incomplete": 0})
def main(
    *worlds: Annotated[str, "worlds to explore; default: demo, random:1 to 20, course, walled"],
    noise: Annotated[float, "add noise of this sigma to lidar ranges (m) and poses (m, rad)"] = 0.0,
    no_peer: Annotated[bool, "skip the mission that explores frontiers only"] = False,
) -> Figures:
    """Explore every world, with the peer too unless `no_peer`."""
    rows: dict[str, dict[str, Any]] = {}
    for world in worlds or WORLDS:
        sigmas = {"range_sigma_m": noise, "pose_sigma_m": noise}
        ours, _ = simulate_exploration(world, **sigmas)
        rows[world] = {**vars(ours), "met": ours.state == "DONE" and ours.read == ours.reachable}
        if not no_peer:
            rows[world]["peer_read"] = simulate_exploration(world, coverage_enabled=False, **sigmas)[0].read
        note(world, rows[world])
    totals = {
        name: sum(row[name] for row in rows.values()) for name in ("read", "reachable", *(() if no_peer else ("peer_read",)))
    }
    return {"worlds": rows, "missions": len(rows), "incomplete": sum(not row["met"] for row in rows.values()), **totals}


if __name__ == "__main__":
    sys.exit(main())
