"""Runs a program until standard input ends, with all that it starts: `python -m lupin_cli.run.process_group PROGRAM ARG...`.

The starter holds the other end of the input. The kernel closes that however the starter ends, also by SIGKILL.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress

TERMINATE_GRACE_S = 5.0
_POLL_S = 0.1


def main(command: list[str]) -> int:
    """Run a program; at the end of the input or of the program, end its process group. Return its exit status, or 0."""
    input_ended = threading.Event()

    def read_input() -> None:
        while os.read(0, 4096):
            pass
        input_ended.set()

    program = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
    threading.Thread(target=read_input, daemon=True).start()
    while not input_ended.is_set():
        with suppress(subprocess.TimeoutExpired):
            status = program.wait(_POLL_S)
            _end_group(program)
            return status
    _end_group(program)
    return 0


def _end_group(leader: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(leader.pid, signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            leader.wait(TERMINATE_GRACE_S)
        os.killpg(leader.pid, signal.SIGKILL)
    leader.wait()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
