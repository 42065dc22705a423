"""The offset of a robot's clock as Lupin measures it over SSH: how often its error bound holds, and how large the bound is.

For comparison, a simple script: `date` over one `ssh`, with half the round trip as the bound. Limits: the true offset is within
the bound in 99 % of runs; the bound is at most 5 ms on a link with a round trip of 2 ms. Needs root (a simulated computer).
"""

from __future__ import annotations

import argparse
import json
import os
import random
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from lupin_sim.host.operator import create_home

WITHIN_LIMIT, BOUND_LIMIT_S = 0.99, 0.005
# Latency and jitter in each direction, ms; 0 is the unimpaired cable. The limit is for the second link, with 2 ms round trip.
LINKS: tuple[tuple[float, float], ...] = ((0.0, 0.0), (1.0, 0.2), (10.0, 5.0), (60.0, 20.0))


def truth_s(host: Any) -> float:
    """Return the true offset of the robot's clock, from the simulation."""
    return float(host.robot.state["clock_offset_s"])


def measure_link(host: Any, target: Any, link: tuple[float, float], runs: int, rng: random.Random) -> dict[str, Any]:
    """Measure `runs` times at exactly known offsets, mostly with a clock that drifts."""
    from lupin_cli.commands.sync_clock import measure_clock

    errors, bounds, within, durations = [], [], 0, []
    for _ in range(runs):
        host.robot.inject_fault("clock-wrong", offset_s=rng.choice((0.0, 1e-3, -287.5, 16_440.0)) + rng.uniform(-1, 1))
        host.robot.inject_fault("clock-drifts", ppm=rng.choice((0.0, -120.0, 120.0)))
        start = time.monotonic()
        drift = measure_clock(target)
        durations.append(time.monotonic() - start)
        # The clock drifts until the true offset is read; this is the uncertainty of the true offset.
        uncertainty_s = 200e-6 * (time.monotonic() - start) + 100e-6
        error = abs(drift.offset.offset_s - truth_s(host))
        within += error <= drift.offset.bound_s + uncertainty_s
        errors.append(error)
        bounds.append(drift.offset.bound_s)
    return {
        "delay_ms": link[0],
        "jitter_ms": link[1],
        "runs": runs,
        "within_bound": round(within / runs, 4),
        "bound_ms_median": round(statistics.median(bounds) * 1e3, 3),
        "bound_ms_max": round(max(bounds) * 1e3, 3),
        "error_ms_max": round(max(errors) * 1e3, 3),
        "seconds_median": round(statistics.median(durations), 3),
    }


def measure_ssh_date(host: Any, runs: int) -> dict[str, float]:
    """Return the median bound and the median error of `ssh robot date`."""
    host.robot.inject_fault("clock-wrong", offset_s=0.0)
    bounds, errors = [], []
    for _ in range(runs):
        sent = time.time()
        shown = host.ssh("date +%s.%N").stdout
        received = time.time()
        bounds.append((received - sent) / 2)
        errors.append(abs(float(shown) - (sent + received) / 2 - truth_s(host)))
    return {"bound_ms": round(statistics.median(bounds) * 1e3, 2), "error_ms": round(statistics.median(errors) * 1e3, 2)}


def main() -> int:
    """Measure the offset over every link; return 1 if a limit is exceeded or no computer can be booted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50, help="measure this many times on each link")
    parser.add_argument("--json", action="store_true", help="print only one JSON line, at the end")
    options = parser.parse_args()
    from lupin_sim.host import Host
    from lupin_sim.host.prerequisites import missing_prerequisite

    if missing := missing_prerequisite():
        print(f"not measured: {missing}", file=sys.stderr)
        return 1
    rng, rows = random.Random(3), []
    with tempfile.TemporaryDirectory() as folder, Host.start() as host:
        os.environ.update(create_home(host, Path(folder)))
        from lupin_cli.connection.inventory import load
        from lupin_cli.connection.options import connect, find_robot

        with host.on_laptop(), connect(find_robot(load(), "mirte")) as target:
            for link in LINKS:
                if link[0]:
                    host.robot.inject_fault("slow-link", delay_ms=link[0], jitter_ms=link[1])
                rows.append(measure_link(host, target, link, options.runs, rng))
                rows[-1]["ssh_date"] = measure_ssh_date(host, 3)
                if link[0]:
                    host.robot.undo_fault("slow-link")
                if not options.json:
                    print(json.dumps(rows[-1]), flush=True)
    total = sum(row["runs"] for row in rows)
    within = sum(row["within_bound"] * row["runs"] for row in rows) / total
    on_two_ms = rows[1]
    result = {
        "within_bound": round(within, 4),
        "limit_within": WITHIN_LIMIT,
        "bound_ms_on_2ms_link": on_two_ms["bound_ms_max"],
        "limit_bound_ms": BOUND_LIMIT_S * 1e3,
        "bound_vs_ssh_date": round(on_two_ms["ssh_date"]["bound_ms"] / on_two_ms["bound_ms_median"], 1),
        "links": rows,
    }
    if options.json:
        print(json.dumps(result))
    else:
        print(
            f"true offset within the bound in {100 * within:.1f} % of {total} runs (limit {100 * WITHIN_LIMIT:.0f} %); "
            f"bound on the 2 ms link at most {on_two_ms['bound_ms_max']:.2f} ms (limit {BOUND_LIMIT_S * 1e3:.0f} ms), "
            f"{result['bound_vs_ssh_date']} times tighter than `ssh date`"
        )
    return 0 if within >= WITHIN_LIMIT and on_two_ms["bound_ms_max"] <= BOUND_LIMIT_S * 1e3 else 1


if __name__ == "__main__":
    sys.exit(main())
