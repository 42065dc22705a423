"""The view of a run, on a terminal and on other outputs."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Console

from lupin_cli.run.live_view import LiveView, run_view

UP: dict[str, Any] = {
    "name": "slam", "phase": "up", "why": "", "restarts": 0, "waiting_for": [], "waiting_s": 0.0, "up_after_s": 1.0,
    "cpu_percent": 1.0, "memory_mb": 1.0, "pid": 1,
}  # fmt: skip


def state(**more: Any) -> dict[str, Any]:
    return {"age_s": 1.0, "stages": [UP], "mission": {}, "rates_hz": {}, **more}


def test_silent_topic_and_its_return_are_printed_once() -> None:
    text = io.StringIO()
    view = LiveView(Console(file=text))
    for silent in ({}, {"/scan": 3.2}, {"/scan": 3.3}, {}):
        view.show(state(silent_s=silent))
    lines = text.getvalue().splitlines()
    assert len(lines) == 3
    assert "slam: up" in lines[0]
    assert "/scan for 3 s" in lines[1] and "lupin doctor" in lines[1]
    assert "receiving again: /scan" in lines[2]


def test_run_view_shows_silent_topics() -> None:
    console = Console(file=io.StringIO(), width=100)
    console.print(run_view(state(silent_s={"/e_stop_state": 12.0})))
    assert "/e_stop_state for 12 s" in console.file.getvalue()  # type: ignore[attr-defined]
