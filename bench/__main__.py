"""`python -m bench [NAME…]`: run the benchmarks one after another, each in its own process."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

TIMEOUT_S = 3600.0
# These take hours, so they run only if they are named on the command line.
LONG = {"generated", "load", "mission", "pasted", "triage"}


def main() -> int:
    """Run the named benchmarks one after another; return 1 if any failed, else 0."""
    names = sorted(path.stem.removeprefix("bench_") for path in Path(__file__).parent.glob("bench_*.py"))
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"benchmarks to run: {', '.join(names)}; default: all except {', '.join(sorted(LONG))}",
    )
    chosen = parser.parse_args().names or [name for name in names if name not in LONG]
    unknown = [name for name in chosen if name not in names]
    if unknown:
        parser.error(f"unknown benchmark {', '.join(unknown)}; choose from: {', '.join(names)}")
    failed = []
    for name in chosen:
        print(f"\n== {name}", flush=True)
        began = time.monotonic()
        try:
            status = subprocess.run([sys.executable, "-m", f"bench.bench_{name}"], timeout=TIMEOUT_S, check=False).returncode
        except subprocess.TimeoutExpired:
            status = -1
        print(f"== {name}: {'ok' if status == 0 else f'status {status}'} in {time.monotonic() - began:.0f} s", flush=True)
        if status != 0:
            failed.append(name)
    if failed:
        print(f"\nfailed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
