"""How much longer `lupin --help` takes than `python -c pass`: wall time, measured in pairs. Limit: 65 ms.

python -m bench.bench_cli [--runs N] [--json]
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time

LIMIT_MS = 65.0


def wall_ms(command: list[str]) -> float:
    """Return the wall time of one run of a command."""
    start = time.perf_counter()
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    return (time.perf_counter() - start) * 1e3


def main() -> int:
    """Time `python -c pass` and `lupin --help` alternately, and print the medians; return 1 if the limit is exceeded."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=21, help="measure this many pairs")
    parser.add_argument("--json", action="store_true", help="print only the JSON line")
    options = parser.parse_args()
    interpreter_ms, lupin_ms = [], []
    for _ in range(options.runs + 1):
        interpreter_ms.append(wall_ms([sys.executable, "-c", "pass"]))
        lupin_ms.append(wall_ms([sys.executable, "-m", "lupin_cli.app", "--help"]))
    # The first pair only warms the file cache.
    overhead_ms = [lupin - bare for bare, lupin in zip(interpreter_ms[1:], lupin_ms[1:], strict=True)]
    result = {
        "python_pass_ms": round(statistics.median(interpreter_ms[1:]), 1),
        "lupin_help_ms": round(statistics.median(lupin_ms[1:]), 1),
        "overhead_ms": round(statistics.median(overhead_ms), 1),
        "limit_ms": LIMIT_MS,
        "ratio_to_limit": round(statistics.median(overhead_ms) / LIMIT_MS, 2),
    }
    if not options.json:
        print(f"python -c pass {result['python_pass_ms']} ms, lupin --help {result['lupin_help_ms']} ms")
        print(f"overhead: {result['overhead_ms']} ms, limit {LIMIT_MS} ms, ratio {result['ratio_to_limit']}")
    print(json.dumps(result))
    return 0 if result["overhead_ms"] <= LIMIT_MS else 1


if __name__ == "__main__":
    sys.exit(main())
