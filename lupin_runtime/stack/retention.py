"""Removes old runs beyond limits. A run that is up, or that a person marked to keep, is never removed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.stack.runs import Run, all_runs

# Generous: a recorded mission takes some 20 MB.
MAX_RUNS = 50
MAX_BYTES = 20 * 10**9
# These stay whatever their size.
NEWEST_KEPT = 5


@dataclass(frozen=True)
class StoredRun:
    """A run on the disk: its size, and whether something protects it from removal."""

    run: Run
    size_bytes: int
    is_live: bool
    is_kept: bool


def stored_runs() -> list[StoredRun]:
    """Return all runs on the disk, oldest first."""
    return [StoredRun(run, _size_bytes(run.path), run.is_live(), run.is_kept()) for run in all_runs()]


def removable(stored: Sequence[StoredRun], max_runs: int = MAX_RUNS, max_bytes: int = MAX_BYTES) -> list[StoredRun]:
    """Return the runs to remove, oldest first, so that at most `max_runs` and `max_bytes` remain."""
    count, size_bytes = len(stored), sum(one.size_bytes for one in stored)
    newest = min(NEWEST_KEPT, max_runs)
    removed = []
    for one in stored[: len(stored) - newest]:
        if count <= max_runs and size_bytes <= max_bytes:
            break
        if not one.is_live and not one.is_kept:
            removed.append(one)
            count -= 1
            size_bytes -= one.size_bytes
    return removed


def remove(stored: StoredRun) -> bool:
    """Remove a run's directory; return whether it is gone."""
    shutil.rmtree(stored.run.path, ignore_errors=True)
    return not stored.run.path.exists()


def remove_old_runs(max_runs: int = MAX_RUNS) -> None:
    """Remove the runs that exceed the limits. One that cannot be removed stays."""
    for old in removable(stored_runs(), max_runs):
        remove(old)


def _size_bytes(path: Path) -> int:
    """Return the disk space of all files below a directory; links are not followed."""
    total = 0
    for folder, _, names in os.walk(path):
        for name in names:
            try:
                total += (Path(folder) / name).lstat().st_blocks * 512
            except OSError:
                continue
    return total
