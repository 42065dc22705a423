"""`python -m tools.busy_loops LOOPS COMMAND...`: run a command beside busy loops, and exit with its status."""

from __future__ import annotations

import os
import subprocess
import sys

# A loop ends with the process that started it, also if that is killed.
_LOOP = "import os, sys\nwhile os.getppid() == int(sys.argv[1]):\n    for _ in range(1_000_000):\n        pass"


def main(arguments: list[str]) -> int:
    """Run the command beside so many loops."""
    count, *command = arguments
    loops = [subprocess.Popen([sys.executable, "-c", _LOOP, str(os.getpid())]) for _ in range(int(count))]
    try:
        return subprocess.run(command, check=False).returncode
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
