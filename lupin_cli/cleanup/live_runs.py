"""The processes of this user's live runs, which a cleanup must spare."""

from __future__ import annotations


def live_run_processes() -> dict[int, str]:
    """The PIDs of this user's live runs, each with the run's name; their children are found through the process tree."""
    from lupin_runtime.stack.runs import live_runs

    found = {}
    for run in live_runs():
        pids = [run.info().get("pid"), *(stage.get("pid") for stage in run.state().get("stages", []))]
        found.update({pid: run.id for pid in pids if isinstance(pid, int)})
    return found
