"""The processes of this user's live runs, which a cleanup must spare."""

from __future__ import annotations


def live_run_processes() -> dict[int, str]:
    """The PIDs of this user's live runs, each with the run's name; their children are found through the process tree."""
    from lupin_runtime.stack.recorded import processes_of, supervisor_of
    from lupin_runtime.stack.runs import live_runs

    return {
        process.pid: run.id for run in live_runs() for process in (supervisor_of(run), *processes_of(run)) if process.exists()
    }
