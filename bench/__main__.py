"""`python -m bench [NAME…]`: list the benchmarks, or run them one after another, each in its own process."""

from __future__ import annotations

import importlib
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated

from bench.runner import MET, MISSED, NOT_MEASURED, Benchmark, note, read_options

TIMEOUT_S = 3600.0


def load_benchmarks() -> dict[str, Benchmark]:
    """Import all benchmarks, and return them by name."""
    names = sorted(path.stem for path in Path(__file__).parent.glob("bench_*.py"))
    found: list[Benchmark] = [importlib.import_module(f"bench.{name}").main for name in names]
    return {each.name: each for each in found}


def run(
    *names: Annotated[str, "benchmarks to run; default: all that do not take hours"],
    list_: Annotated[bool, "say what each benchmark measures, and its limits, and run nothing"] = False,
    json: Annotated[bool, "print one JSON line for each benchmark instead of a table"] = False,
) -> int:
    """Run the named benchmarks; return 1 if one missed a limit or could not measure, else 0."""
    benchmarks = load_benchmarks()
    if unknown := [name for name in names if name not in benchmarks]:
        note(f"unknown benchmark {', '.join(unknown)}; choose from: {', '.join(benchmarks)}")
        return NOT_MEASURED
    if list_:
        for each in benchmarks.values():
            print(f"{each.name:13} {each.description.splitlines()[0]}{' Takes hours.' if each.long else ''}")
            print("".join(f"{'':15}{figure} {sign} {bound:g}\n" for figure, sign, bound in each.limits), end="")
        return MET
    results = {}
    for name in names or [name for name, each in benchmarks.items() if not each.long]:
        note(f"\n== {name}")
        began_s = time.monotonic()
        command = [sys.executable, "-m", f"bench.bench_{name}", *["--json"] * json]
        try:
            status = subprocess.run(command, timeout=TIMEOUT_S, check=False).returncode
        except subprocess.TimeoutExpired:
            status = NOT_MEASURED
        results[name] = {MET: "met", MISSED: "missed"}.get(status, "not measured")
        note(f"== {name}: {results[name]}, {time.monotonic() - began_s:.0f} s")
    if failed := [f"{name} ({result})" for name, result in results.items() if result != "met"]:
        note(f"\n{', '.join(failed)}")
    return MISSED if failed else MET


if __name__ == "__main__":
    names, options = read_options(run, None, "bench", __doc__ or "")
    sys.exit(run(*names, **options))
