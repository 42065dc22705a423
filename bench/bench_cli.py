"""`lupin --help` over the bare interpreter, in pairs. Limit: 65 ms above `python -c pass`."""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time

LIMIT_MS = 65.0


def wall_ms(command: list[str]) -> float:
    """Wall time of one run of a command."""
    began = time.perf_counter()
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    return (time.perf_counter() - began) * 1e3


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=21)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    bare, ours = [], []
    for _ in range(options.runs + 1):
        bare.append(wall_ms([sys.executable, "-c", "pass"]))
        ours.append(wall_ms([sys.executable, "-m", "lupin_cli.app", "--help"]))
    # The first pair warms the file cache.
    above = [b - a for a, b in zip(bare[1:], ours[1:], strict=True)]
    result = {
        "python_pass_ms": round(statistics.median(bare[1:]), 1),
        "lupin_help_ms": round(statistics.median(ours[1:]), 1),
        "above_ms": round(statistics.median(above), 1),
        "limit_ms": LIMIT_MS,
        "ratio_to_limit": round(statistics.median(above) / LIMIT_MS, 2),
    }
    if not options.json:
        print(f"python -c pass {result['python_pass_ms']} ms, lupin --help {result['lupin_help_ms']} ms")
        print(f"above: {result['above_ms']} ms, limit {LIMIT_MS} ms, ratio {result['ratio_to_limit']}")
    print(json.dumps(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
