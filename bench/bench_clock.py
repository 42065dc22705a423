"""The drift of a robot's clock over SSH: is the truth within the bound, and how wide is that? Needs root (a booted host).

Beside it, in the same runs, what a script would do: `date` over one `ssh` of its own, with half its round trip as the bound.
Limits: the truth within the bound in 99 % of runs; bound at most 5 ms on a link of 2 ms.
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

from lupin_sim.host.operator import furnish

WITHIN_LIMIT, BOUND_LIMIT_S = 0.99, 0.005
# Latency and jitter each way, ms; none: the cable as it is. The second is the link of the limit, 2 ms there and back.
LINKS: tuple[tuple[float, float], ...] = ((0.0, 0.0), (1.0, 0.2), (10.0, 5.0), (60.0, 20.0))


def truth_s(host: Any) -> float:
    """How far the robot's clock is ahead, as the machine that keeps it says."""
    return float(host.robot.state["clock_offset_s"])


def one_link(host: Any, target: Any, link: tuple[float, float], runs: int, dice: random.Random) -> dict[str, Any]:
    """Measure `runs` times at offsets that are known to the nanosecond, most with a crystal that runs off as well."""
    from lupin_cli.commands.sync_clock import measure_drift

    errors, bounds, within, took = [], [], 0, []
    for _ in range(runs):
        host.robot.fault("clock-wrong", offset_s=dice.choice((0.0, 1e-3, -287.5, 16_440.0)) + dice.uniform(-1, 1))
        host.robot.fault("clock-drifts", ppm=dice.choice((0.0, -120.0, 120.0)))
        began = time.monotonic()
        drift = measure_drift(target)
        took.append(time.monotonic() - began)
        # The clock runs off while the keeper is asked: that much is the truth's own uncertainty.
        late_s = 200e-6 * (time.monotonic() - began) + 100e-6
        error = abs(drift.offset.offset_s - truth_s(host))
        within += error <= drift.offset.bound_s + late_s
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
        "seconds_median": round(statistics.median(took), 3),
    }


def naive(host: Any, runs: int) -> dict[str, float]:
    """`ssh robot date`, once: what its bound is."""
    host.robot.fault("clock-wrong", offset_s=0.0)
    bounds, errors = [], []
    for _ in range(runs):
        sent = time.time()
        said = host.ssh("date +%s.%N").stdout
        received = time.time()
        bounds.append((received - sent) / 2)
        errors.append(abs(float(said) - (sent + received) / 2 - truth_s(host)))
    return {"bound_ms": round(statistics.median(bounds) * 1e3, 2), "error_ms": round(statistics.median(errors) * 1e3, 2)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50, help="per link")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    from lupin_sim.host import Host
    from lupin_sim.host.missing import what_is_missing

    if missing := what_is_missing():
        print(f"not measured: {missing}", file=sys.stderr)
        return 1
    dice, rows = random.Random(3), []
    with tempfile.TemporaryDirectory() as folder, Host.start() as host:
        os.environ.update(furnish(host, Path(folder)))
        from lupin_cli.config import load
        from lupin_cli.robot_options import connect, named

        with host.on_laptop(), connect(named(load(), "mirte")) as target:
            for link in LINKS:
                if link[0]:
                    host.robot.fault("slow-link", delay_ms=link[0], jitter_ms=link[1])
                rows.append(one_link(host, target, link, options.runs, dice))
                rows[-1]["ssh_date"] = naive(host, 3)
                if link[0]:
                    host.robot.mend("slow-link")
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
            f"truth within the bound in {100 * within:.1f} % of {total} runs (limit {100 * WITHIN_LIMIT:.0f} %); "
            f"bound on 2 ms at most {on_two_ms['bound_ms_max']:.2f} ms (limit {BOUND_LIMIT_S * 1e3:.0f} ms), "
            f"{result['bound_vs_ssh_date']} times tighter than `ssh date`"
        )
    return 0 if within >= WITHIN_LIMIT and on_two_ms["bound_ms_max"] <= BOUND_LIMIT_S * 1e3 else 1


if __name__ == "__main__":
    sys.exit(main())
