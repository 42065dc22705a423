"""A program that is not ours as a process of the stack: `python -m lupin_runtime.stack.external PROGRAM ARGUMENT...`

It ends with the run, however the run ends. Whoever closes its window has closed it: it is not opened again.
"""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
import threading

from lupin_runtime.ros.parent import end_with_parent

TERMINATE_GRACE_S = 2.0
_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def main(command: list[str]) -> int:
    """Run a program until it ends or SIGTERM comes, then wait for the end of the run; returns the exit status."""
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    end_with_parent()
    prctl = ctypes.CDLL(None).prctl
    # Should this process be killed, the kernel tells the program; nothing else would.
    child = subprocess.Popen(command, stdin=subprocess.DEVNULL, preexec_fn=lambda: prctl(_PR_SET_PDEATHSIG, signal.SIGTERM))
    while not ended.wait(0.2):
        if child.poll() is not None:
            print(f"{command[0]} has ended with status {child.returncode}; it is not started again", flush=True)
            ended.wait()
    child.terminate()
    try:
        child.wait(TERMINATE_GRACE_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
