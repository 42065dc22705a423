"""The `state.json` of a run that is up: a full disk costs the records of a run, never the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from lupin_runtime.stack.runs import Run


def unwritable(run: Run, error: OSError) -> str:
    """Return why a run's records are not written, and what to do."""
    return f"the run's records in {run.path} cannot be written: {error.strerror or error}; free space on its disk"


class StateFile:
    """Writes the state of a run. `report` receives each reason why that fails once, until it succeeds again."""

    def __init__(self, run: Run, report: Callable[[str], None] = lambda _: None) -> None:
        self._run, self._report = run, report
        self.problem = ""  # why the last state was not written

    def write(self, state: Mapping[str, Any]) -> None:
        """Replace `state.json`. A failure is in `problem`; the processes of the run need no file."""
        problem = ""
        try:
            self._run.write_state(state)
        except OSError as error:
            problem = unwritable(self._run, error)
        if problem and problem != self.problem:
            self._report(problem)
        self.problem = problem
