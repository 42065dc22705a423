"""Explorations in the mission simulator: tags read, distance driven, simulated time.

The peer is a mission that explores frontiers only. Limit: in every world, Lupin reads every reachable tag.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict

from tests.support.mission_simulator import simulate_exploration

WORLDS = ("demo", *(f"random:{seed}" for seed in range(1, 21)), "course", "walled")


def main() -> int:
    """Explore every world, with the peer too unless `--no-peer`; return 1 if a mission is incomplete."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "worlds", nargs="*", default=list(WORLDS), help="worlds to explore; default: demo, random:1 to 20, course, walled"
    )
    parser.add_argument(
        "--noise", type=float, default=0.0, help="add noise of this sigma to lidar ranges (m) and poses (m, rad)"
    )
    parser.add_argument("--no-peer", action="store_true", help="skip the mission that explores frontiers only")
    parser.add_argument("--json", action="store_true", help="also print one JSON line at the end")
    arguments = parser.parse_args()
    print(f"{'world':12s} {'state':8s} {'read':>9s} {'explored s':>10s} {'mission s':>9s} {'driven m':>8s} {'frontiers':>14s}")
    results = []
    for world in arguments.worlds:
        noise = {"range_sigma_m": arguments.noise, "pose_sigma_m": arguments.noise}
        ours, _ = simulate_exploration(world, **noise)
        peer = None if arguments.no_peer else simulate_exploration(world, coverage_enabled=False, **noise)[0]
        results.append({**asdict(ours), "peer_read": peer.read if peer else None})
        print(
            f"{world:12s} {ours.state:8s} {ours.read:4d}/{ours.reachable:<4d} {ours.exploration_s:10.0f} {ours.mission_s:9.0f}"
            f" {ours.driven_m:8.1f} {f'{peer.read}/{peer.reachable}' if peer else '-':>14s}",
            flush=True,
        )
    complete = sum(result["state"] == "DONE" and result["read"] == result["reachable"] for result in results)
    read, reachable = sum(r["read"] for r in results), sum(r["reachable"] for r in results)
    peer_read = None if arguments.no_peer else sum(r["peer_read"] for r in results)
    by_peer = "" if peer_read is None else f", with frontiers only {peer_read}"
    print(f"{complete} of {len(results)} missions complete; {read} of {reachable} tags read{by_peer}")
    if arguments.json:
        print(
            json.dumps(
                {"complete": complete, "worlds": len(results), "read": read, "reachable": reachable, "peer_read": peer_read}
            )
        )
    return 0 if complete == len(results) else 1


if __name__ == "__main__":
    sys.exit(main())
