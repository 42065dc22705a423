"""The exit codes of `lupin`. Every command uses these; its --help says what they mean for it.

`lupin up` passes on the codes of `lupin_runtime.stack.session`, which are the same numbers.
"""

from __future__ import annotations

from collections.abc import Iterable

SUCCESS = 0  # done, healthy, or nothing to do
FAILURE = 1  # something failed, was declined, or needs attention
USAGE_ERROR = 2  # an argument, an option or a file of the user cannot be used
UNREACHABLE = 3  # no connection to the robot, no live run to act on, or a stack that never came up
NO_RESULT = 4  # the command's own work failed: a diagnosis with gaps, an archive that could not be written
INTERNAL_ERROR = 70  # an unexpected exception; EX_SOFTWARE of sysexits.h
INTERRUPTED = 130  # Ctrl-C: 128 + SIGINT


def worst(codes: Iterable[int]) -> int:
    """Return one code for several robots: the first that occurs of interrupted, unreachable, failed, done."""
    found = set(codes)
    return next((code for code in (INTERRUPTED, UNREACHABLE, FAILURE) if code in found), SUCCESS)
