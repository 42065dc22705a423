"""The view of a run, on a terminal and on other outputs."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.run.live_view import LiveView, Repainter, run_view
from lupin_cli.run.summary import summarize
from lupin_cli.safe_console import SafeConsole
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.stack_runner import Outcome

CLEAR = "\x1b[2J"  # erases the screen
UP: dict[str, Any] = {
    "name": "slam", "phase": "up", "why": "", "restarts": 0, "waiting_for": [], "waiting_s": 0.0, "up_after_s": 1.0,
    "cpu_percent": 1.0, "memory_mb": 1.0, "pid": 1,
}  # fmt: skip


def state(**more: Any) -> dict[str, Any]:
    return {"age_s": 1.0, "stages": [UP], "mission": {}, "rates_hz": {}, **more}


def test_silent_topic_and_its_return_are_printed_once() -> None:
    text = io.StringIO()
    view = LiveView(SafeConsole(file=text))
    for silent in ({}, {"/scan": 3.2}, {"/scan": 3.3}, {}):
        view.show(state(silent_s=silent))
    lines = text.getvalue().splitlines()
    assert len(lines) == 3
    assert "slam: up" in lines[0]
    assert "/scan for 3 s" in lines[1] and "lupin doctor" in lines[1]
    assert "receiving again: /scan" in lines[2]


def test_run_view_shows_silent_topics() -> None:
    console = SafeConsole(file=io.StringIO(), width=100)
    console.print(run_view(state(silent_s={"/e_stop_state": 12.0}), console))
    assert "/e_stop_state for 12 s" in console.file.getvalue()  # type: ignore[attr-defined]


def test_reason_for_the_end_of_a_run_is_stated_once(tmp_path: Path) -> None:
    """The view names the process that failed; the result says why, and which log says more."""
    reason = "exited with status 1: ValueError: seed"
    consequence = "its state is lost, so the run was stopped"
    death = {"stage": "sim", "status": reason, "consequence": consequence, "ends_run": True}
    failed = {**UP, "name": "sim", "phase": "failed", "why": f"{reason}; {consequence}; log: /logs/sim.log"}
    outcome = Outcome(1, "LOST", f"sim {reason}; {consequence}", "sim", deaths=[death])
    for width in (80, 100):
        text = io.StringIO()
        console = SafeConsole(file=text, width=width)
        with LiveView(console) as view:
            view.show(state(stages=[failed], deaths=[death]))
        console.print(run_view(state(stages=[failed], deaths=[death]), console))
        summarize(Run(tmp_path), Options(), outcome, console)
        printed = " ".join(text.getvalue().split())
        assert printed.count("ValueError") == printed.count("its state is lost") == 1, printed
        assert "sim: failed" in printed and f"next: lupin logs sim --run {tmp_path.name}" in printed
    assert json.loads((tmp_path / "result.json").read_text())["outcome"]["sentence"] == outcome.sentence


def test_restart_is_told_beside_the_reason_of_the_end(tmp_path: Path) -> None:
    deaths = [
        {"stage": "nav", "status": "was killed by SIGKILL", "consequence": "restarted", "ends_run": False},
        {"stage": "sim", "status": "exited with status 1", "consequence": "the run was stopped", "ends_run": True},
    ]
    text = io.StringIO()
    outcome = Outcome(1, "LOST", "sim exited with status 1; the run was stopped", "sim", deaths=deaths)
    summarize(Run(tmp_path), Options(), outcome, SafeConsole(file=text))
    assert "nav was killed by SIGKILL: restarted" in text.getvalue() and text.getvalue().count("exited with status 1") == 1


MISSION: dict[str, Any] = {
    "lifecycle_state": "MONITORING", "mission_phase": "NAVIGATING", "current_target": "19", "targets_total": 12,
    "targets_completed": 3, "targets_failed": 1, "targets_unreachable": 0, "tags_discovered": 12, "estop_engaged": False,
    "paused": False, "battery_low": False, "battery_percentage": 0.8, "last_event": "", "clock_s": 397.0,
}  # fmt: skip
ROOM: dict[str, Any] = {
    "map": {"x": 0.0, "y": 0.0, "cell_m": 0.1, "rows": ["#" * 80, *["#" + "." * 78 + "#"] * 50, "#" * 80], "free_m2": 39.0},
    "pose": [2.0, 2.0, 0.0], "plan": [[2.0, 2.0], [5.0, 2.0]], "trail": [[1.0, 1.0]], "distance_m": 81.0,
    "speed_m_s": 0.52, "real_time_factor": 1.0, "battery": 0.86,
    "tags": [{"id": str(at), "x": 5.0, "y": 3.0, "read": at < 10} for at in range(10, -1, -1)],
}  # fmt: skip
EVENTS = [{"clock_s": 60.0 * at, "text": f"tag {at} read"} for at in range(8)]


def painted(width: int, height: int, *, terminal: bool = True, **more: Any) -> list[str]:
    text = io.StringIO()
    console = SafeConsole(file=text, width=width, height=height, force_terminal=terminal, color_system=None)
    console.print(run_view(state(mission=MISSION, robot=ROOM, events=EVENTS, ready_s=12.6, **more), console))
    return text.getvalue().splitlines()


@pytest.mark.parametrize("size", [(100, 34), (80, 24), (200, 60), (79, 30)])
def test_view_of_a_mission_fits_the_terminal(size: tuple[int, int]) -> None:
    width, height = size
    lines = painted(width, height)
    assert len(lines) < height and max(map(len, lines)) <= width
    assert lines[0].startswith("Driving to tag 19") and lines[0].rstrip().endswith("mission clock  6:37")
    assert "12 discovered · 10 read · 3 of 12 again · 1 failed" in lines[1] and "3.0 m to go at 0.52 m/s" in lines[1]
    assert lines[2].split() == ["●"] * 10 + ["○"] * 2
    text = "\n".join(lines)
    assert "▶" in text and "1 of 1 processes up" in text
    assert all(word in text for word in ("battery", "86 %", "81.0 m", "1.00 x", "tag 7 read"))


@pytest.mark.parametrize(("size", "terminal"), [((60, 40), True), ((100, 14), True), ((100, 34), False)])
def test_map_gives_way_to_what_matters(size: tuple[int, int], terminal: bool) -> None:
    text = "\n".join(painted(*size, terminal=terminal))
    assert "▶" not in text and "Driving to tag 19" in text and "processes up" in text


def test_stop_and_alarms_come_before_the_map() -> None:
    ill = {**UP, "name": "nav", "trouble": "does not respond"}
    mission = {**MISSION, "estop_engaged": True}
    text = io.StringIO()
    console = SafeConsole(file=text, width=100, height=34, force_terminal=True, color_system=None)
    console.print(
        run_view(state(mission=mission, robot=ROOM, events=EVENTS, stages=[UP, ill], alarms=["a node drives"]), console)
    )
    lines = text.getvalue().splitlines()
    assert lines[0].startswith("STOPPED  the e-stop is engaged; was Driving to tag 19")
    assert ["does not respond" in lines[3], "a node drives" in lines[4]] == [True, True]
    assert any("1 of 2 processes up" in line for line in lines) and any("nav" in line for line in lines[-4:])
    assert len(lines) < 34


def test_count_of_one_tag_is_singular() -> None:
    text = io.StringIO()
    view = LiveView(SafeConsole(file=text))
    for tags in (1, 2):
        view.show(state(mission={**MISSION, "tags_discovered": tags}))
    assert "· 1 tag ·" in text.getvalue() and "· 2 tags ·" in text.getvalue()


def test_smaller_terminal_begins_on_an_empty_screen() -> None:
    text = io.StringIO()
    console = SafeConsole(file=text, width=100, height=34, force_terminal=True)
    with Repainter(console) as repainter:
        repainter.paint("first view")
        repainter.paint("second view")
        assert CLEAR not in text.getvalue()
        console.width = 60
        repainter.paint("third view")
    before, after = text.getvalue().split(CLEAR)
    assert "second view" in before and "second view" not in after and "third view" in after


def test_damaged_position_leaves_the_rest_of_the_view() -> None:
    text = io.StringIO()
    console = SafeConsole(file=text, width=100, height=34, force_terminal=True, color_system=None)
    for damage in ({"pose": [1.0]}, {"plan": [[1.0]]}, {"trail": [[1.0, 2.0, 3.0]]}):
        console.print(run_view(state(mission=MISSION, robot={**ROOM, **damage}, events=EVENTS), console))
    assert text.getvalue().count("Driving to tag 19") == 3 and "▶" not in text.getvalue()
