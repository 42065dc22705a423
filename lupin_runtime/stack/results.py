"""How a run ended, or that it is up, from the files in its directory: the same for all commands and for the console."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from lupin_runtime.atomic_file import read_json_object
from lupin_runtime.stack.recorded import is_supervised
from lupin_runtime.stack.runs import Run

UP, DONE, INTERRUPTED, NO_RESULT = "up", "DONE", "INTERRUPTED", "NO_RESULT"
_NO_RESULT = "killed, or the computer was switched off"


@dataclass(frozen=True)
class RunResult:
    """What is known of a run. `state` is up, NO_RESULT or the state of its outcome, such as DONE, LOST or INTERRUPTED.

    `why` is empty for a run that is up, DONE or INTERRUPTED. What a run does not have, such as tags without a mission, is None.
    """

    id: str
    state: str
    why: str
    world: str  # of the simulator; "robot" for a run with a robot
    started_s: float | None  # since the epoch
    duration_s: float | None
    tags_read: int | None
    tags_total: int | None
    report: str | None  # the page's path, if it exists

    def as_json(self) -> dict[str, Any]:
        """Return the fields for scripts."""
        return asdict(self)


def result_of(run: Run) -> RunResult:
    """Return the result of a run. Damaged files and values of the wrong kind are treated as missing."""
    is_live = run.is_live() and is_supervised(run)
    info, state, result = run.info(), run.state(), read_json_object(run.path / "result.json")
    options = _object(info.get("options"))
    outcome = _object(state.get("outcome")) or _object(result.get("outcome"))
    mission = _object(outcome.get("mission") if outcome else state.get("mission"))
    has_mission = bool(options.get("mission")) or bool(mission.get("mission_id"))
    tags_read = _count(result.get("tags_read"), mission.get("targets_completed")) if has_mission else None
    # A mission that was given its tags discovers none.
    tags_total = _count(result.get("tags_found"), mission.get("tags_discovered"), mission.get("targets_total"))
    page = run.report / "report.html"
    return RunResult(
        id=run.id,
        state=UP if is_live else _text(outcome.get("state")) or NO_RESULT,
        why="" if is_live else _why(outcome),
        world="robot" if options.get("target") == "robot" else _text(options.get("world")),
        started_s=_number(info.get("started")),
        duration_s=_number(outcome.get("wall_time_s")) if outcome else _number(state.get("age_s")),
        tags_read=tags_read,
        tags_total=None if tags_read is None else max(tags_read, tags_total or 0),
        report=str(page) if page.is_file() else None,
    )


def _why(outcome: dict[str, Any]) -> str:
    if not outcome:
        return _NO_RESULT
    return "" if outcome.get("state") in (DONE, INTERRUPTED) else _text(outcome.get("sentence"))


def _object(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""


def _number(value: object) -> float | None:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return float(value) if is_number and math.isfinite(value) else None  # type: ignore[arg-type]


def _count(*values: object) -> int | None:
    """Return the first value that is a count of something, else the first that is a count at all."""
    counts = [value for value in values if type(value) is int and value >= 0]
    return next((count for count in counts if count), counts[0] if counts else None)
