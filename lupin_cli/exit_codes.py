"""The exit codes of `lupin`. Every command uses these; its --help says what they mean for it."""

from __future__ import annotations

from collections.abc import Iterable

from lupin_runtime.exit_codes import FAILURE, INTERRUPTED, SUCCESS, UNREACHABLE, USAGE_ERROR

__all__ = ["FAILURE", "INTERNAL_ERROR", "INTERRUPTED", "NO_RESULT", "SUCCESS", "UNREACHABLE", "USAGE_ERROR", "worst"]

NO_RESULT = 4  # the command's own work failed: a diagnosis with gaps, an archive that could not be written
INTERNAL_ERROR = 70  # an unexpected exception; EX_SOFTWARE of sysexits.h


def worst(codes: Iterable[int]) -> int:
    """Return one code for several robots: the first that occurs of interrupted, unreachable, failed, done."""
    found = set(codes)
    return next((code for code in (INTERRUPTED, UNREACHABLE, FAILURE) if code in found), SUCCESS)
