"""Runs a third-party program as a process of the stack: `python -m lupin_runtime.stack.external PROGRAM ARGUMENT...`.

The program is terminated with the run, however the run ends. If its window is closed, it is not started again.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading

from lupin_runtime.environment import without_ros_wheels
from lupin_runtime.ros.supervision import end_with_parent

TERMINATE_GRACE_S = 2.0
_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def main(command: list[str]) -> int:
    """Run a program until SIGTERM arrives; if it exits earlier, wait for SIGTERM. Return the exit status."""
    terminated = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: terminated.set())
    end_with_parent()
    prctl = ctypes.CDLL(None).prctl
    # If this process is killed, the kernel sends SIGTERM to the program.
    child = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        env=without_ros_wheels(os.environ),
        preexec_fn=lambda: prctl(_PR_SET_PDEATHSIG, signal.SIGTERM),
    )
    while not terminated.wait(0.2):
        if child.poll() is not None:
            print(f"{command[0]} exited with status {child.returncode}; it is not started again", flush=True)
            terminated.wait()
    child.terminate()
    try:
        child.wait(TERMINATE_GRACE_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
