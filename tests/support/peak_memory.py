"""Run `lupin` in a process of its own, and measure the memory that it takes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tests.support.paths import ROOT

TIMEOUT_S = 120.0


# The largest memory of the process since it began to run Python: what wait4 tells includes the process that started it.
PROGRAM = """
import atexit, sys
peak = sys.argv.pop(1)
atexit.register(lambda: open(peak, "w").write(open("/proc/self/status").read()))
from lupin_cli.app import main
main()
"""


@dataclass(frozen=True)
class Measured:
    """The end of a process: exit status, what it printed on both streams, its largest resident memory."""

    status: int
    printed: str
    peak_mb: float


def run_measured(*words: str, cwd: Path) -> Measured:
    """Run `lupin` with these words until it ends."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_STATE_HOME": str(cwd / "state")}
    with tempfile.TemporaryDirectory() as folder:
        peak = Path(folder) / "status"
        command = [sys.executable, "-P", "-c", PROGRAM, str(peak), *words]
        done = subprocess.run(
            command, cwd=cwd, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=TIMEOUT_S, check=False
        )
        found = re.search(r"^VmHWM:\s+(\d+) kB$", peak.read_text(), re.MULTILINE)
        assert found is not None
        return Measured(done.returncode, done.stdout.decode(errors="replace"), int(found[1]) / 1024)
