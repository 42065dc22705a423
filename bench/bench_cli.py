"""How much longer `lupin --help` takes than `python -c pass`: wall time, measured in pairs."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from typing import Annotated

from bench.runner import Figures, benchmark


def wall_ms(command: list[str]) -> float:
    """Return the wall time of one run of a command."""
    start = time.perf_counter()
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    return (time.perf_counter() - start) * 1e3


@benchmark(at_most={"overhead_ms": 65.0})
def main(runs: Annotated[int, "measure this many pairs"] = 21) -> Figures:
    """Time `python -c pass` and `lupin --help` alternately, and return the medians."""
    interpreter_ms, lupin_ms = [], []
    for _ in range(runs + 1):
        interpreter_ms.append(wall_ms([sys.executable, "-c", "pass"]))
        lupin_ms.append(wall_ms([sys.executable, "-m", "lupin_cli.app", "--help"]))
    # The first pair only warms the file cache.
    overhead_ms = [lupin - bare for bare, lupin in zip(interpreter_ms[1:], lupin_ms[1:], strict=True)]
    return {
        "python_pass_ms": statistics.median(interpreter_ms[1:]),
        "lupin_help_ms": statistics.median(lupin_ms[1:]),
        "overhead_ms": statistics.median(overhead_ms),
    }


if __name__ == "__main__":
    sys.exit(main())
