"""Ending a process whose middleware may never return.

Fast DDS may hang when it deletes a participant while another one vanishes: it waits, spinning, for a callback that waits for
the lock which it holds itself (https://github.com/eProsima/Fast-DDS/issues/6513). rclpy calls it with Python's global lock
held: from then on, no thread and no signal handler of Python runs.
"""

from __future__ import annotations

import faulthandler
import os
import sys
import threading
from typing import NoReturn

STUCK = threading.Event()  # set when a thread is in the middleware for ever: end by `exit_with`


def exit_within(seconds: float) -> None:
    """End this process with status 1 after `seconds`, with its stacks on stderr, even if no thread of Python runs any more."""
    faulthandler.dump_traceback_later(seconds, file=2, exit=True)


def exit_with(status: int) -> NoReturn:
    """Exit at once, after flushing all output. A normal interpreter shutdown after DDS is slow and may abort."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
