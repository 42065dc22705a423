"""The offset of a robot's clock as Lupin measures it over SSH: how often its error bound holds, and how large the bound is.

For comparison, a simple script: `date` over one `ssh`, with half the round trip as the bound. Needs root (a simulated
computer).
"""

from __future__ import annotations

import os
import random
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated, Any

from bench.runner import Figures, benchmark, note
from lupin_sim.host.operator import create_home

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
        "within_bound": within / runs,
        "bound_ms_median": statistics.median(bounds) * 1e3,
        "bound_ms_max": max(bounds) * 1e3,
        "error_ms_max": max(errors) * 1e3,
        "seconds_median": statistics.median(durations),
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
    return {"ssh_date_bound_ms": statistics.median(bounds) * 1e3, "ssh_date_error_ms": statistics.median(errors) * 1e3}


@benchmark(at_least={"within_bound_of_all": 0.99}, at_most={"bound_ms_on_2ms_link": 5.0})
def main(runs: Annotated[int, "measure this many times on each link"] = 50) -> Figures:
    """Measure the offset over every link."""
    from lupin_sim.host import Host
    from lupin_sim.host.prerequisites import missing_prerequisite

    if missing := missing_prerequisite():
        raise SystemExit(f"not measured: {missing}")
    rng, links = random.Random(3), {}
    with tempfile.TemporaryDirectory() as folder, Host.start() as host:
        os.environ.update(create_home(host, Path(folder)))
        from lupin_cli.connection.inventory import load
        from lupin_cli.connection.options import connect, find_robot

        with host.on_laptop(), connect(find_robot(load(), "mirte")) as target:
            for link in LINKS:
                if link[0]:
                    host.robot.inject_fault("slow-link", delay_ms=link[0], jitter_ms=link[1])
                figures = measure_link(host, target, link, runs, rng) | measure_ssh_date(host, 3)
                links[f"{2 * link[0]:g} ms round trip"] = figures
                if link[0]:
                    host.robot.undo_fault("slow-link")
                note(f"delay {link[0]:g} ms", figures)
    on_two_ms = links["2 ms round trip"]
    return {
        "links": links,
        "runs": runs * len(links),
        "within_bound_of_all": statistics.mean(figures["within_bound"] for figures in links.values()),
        "bound_ms_on_2ms_link": on_two_ms["bound_ms_max"],
        "bound_vs_ssh_date": on_two_ms["ssh_date_bound_ms"] / on_two_ms["bound_ms_median"],
    }


if __name__ == "__main__":
    sys.exit(main())
