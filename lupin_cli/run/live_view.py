"""The live view of a run: its stages with the conditions they wait for, and the mission's progress."""

from __future__ import annotations

from typing import Any

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from lupin_cli.terminal import printable
from lupin_runtime.stack.alarms import alarms

PHASE_STYLE = {"waiting": "dim", "starting": "yellow", "up": "green", "failed": "bold red", "stopped": "dim"}
PHASE_MARK = {"waiting": "·", "starting": "…", "up": "✓", "failed": "✗", "stopped": "–"}


def stage_table(state: dict[str, Any]) -> Table:
    """Return a table of the stages; `state` is the content of `state.json`."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("stage", no_wrap=True)
    table.add_column("up after", justify="right", no_wrap=True)
    table.add_column("cpu", justify="right", no_wrap=True)
    table.add_column("memory", justify="right", no_wrap=True)
    table.add_column("", ratio=1)
    for stage in state.get("stages", []):
        phase = stage["phase"]
        style = PHASE_STYLE.get(phase, "")
        note = stage["why"]
        if stage["waiting_for"]:
            note = f"{stage['waiting_s']:.0f} s for {'; '.join(stage['waiting_for'])}"
        if stage["restarts"]:
            note = f"restarted {stage['restarts']}×  {note}"
        table.add_row(
            Text(f"{PHASE_MARK.get(phase, ' ')} {stage['name']}", style=style),
            f"{stage['up_after_s']:.1f} s" if stage["up_after_s"] is not None else "",
            f"{stage['cpu_percent']:.0f} %" if stage["pid"] else "",
            f"{stage['memory_mb']:.0f} MB" if stage["memory_mb"] else "",
            Text(note, style=style),
        )
    return table


def mission_lines(mission: dict[str, Any]) -> list[RenderableType]:
    """Return lines on the mission's state, progress and interruptions; empty without a mission."""
    if not mission:
        return []
    state = mission["lifecycle_state"]
    line = Text.assemble((f" {state} ", "black on cyan"), " ", mission["mission_phase"])
    if mission["current_target"]:
        line.append(f"  tag {mission['current_target']}", "bold")
    if mission["estop_engaged"]:
        line.append("  E-STOP", "bold white on red")
    if mission["paused"]:
        line.append("  paused", "bold yellow")
    if mission["battery_low"]:
        line.append("  battery low", "bold magenta")
    lines: list[RenderableType] = [line]
    if state == "EXPLORING":
        lines.append(Text(f" {mission['tags_discovered']} tags discovered"))
    if mission["targets_total"]:
        done = mission["targets_completed"] + mission["targets_failed"] + mission["targets_unreachable"]
        lines.append(ProgressBar(total=mission["targets_total"], completed=done, width=40))
        lines.append(
            Text(
                f" {mission['targets_completed']} of {mission['targets_total']} read"
                f" · {mission['targets_failed']} failed · {mission['targets_unreachable']} unreachable"
            )
        )
    if mission["last_event"]:
        lines.append(Text(f" last: {mission['last_event']}", style="dim"))
    return lines


def silence_text(state: dict[str, Any]) -> str:
    """Return a warning about topics that have fallen silent; empty if none has."""
    silent: dict[str, float] = state.get("silent_s", {})
    if not silent:
        return ""
    topics = ", ".join(f"{name} for {age:.0f} s" for name, age in silent.items())
    return f"silent: {topics}; find the cause with: lupin doctor"


def run_view(state: dict[str, Any]) -> Group:
    """Return the complete view of a run."""
    memory = sum(stage["memory_mb"] for stage in state.get("stages", []))
    cpu = sum(stage["cpu_percent"] for stage in state.get("stages", []))
    rates = "  ".join(f"{name} {hz:.1f} Hz" for name, hz in state.get("rates_hz", {}).items() if hz > 0.0)
    head = Text.assemble(
        ("Lupin ", "bold"), (state.get("id", ""), "cyan"), f"  {state.get('age_s', 0.0):.0f} s", style="default"
    )
    foot = Text(f"{cpu:.0f} % of a core · {memory:.0f} MB   {rates}", style="dim")
    alarm_lines = [Text(f"▲ {printable(alarm)}", style="bold red") for alarm in (silence_text(state), *alarms(state)) if alarm]
    return Group(head, stage_table(state), foot, *alarm_lines, *mission_lines(state.get("mission", {})))


class LiveView:
    """Shows the states of a run: repainted on a terminal, one line per change on other outputs."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, auto_refresh=False, transient=False) if console.is_terminal else None
        self._phases: dict[str, str] = {}
        self._last_mission = ""
        self._silent: list[str] = []
        self._alarms: list[str] = []
        self._calls = 0

    def __enter__(self) -> LiveView:
        if self._live is not None:
            self._live.__enter__()
        return self

    def __exit__(self, *details: Any) -> None:
        if self._live is not None:
            self._live.__exit__(*details)

    def show(self, state: dict[str, Any]) -> None:
        """Show the newest state."""
        self._calls += 1
        if self._live is not None:
            if self._calls % 3 == 1:  # states arrive ten times a second; about three repaints are enough
                self._live.update(run_view(state), refresh=True)
            return
        for stage in state["stages"]:
            phase = stage["phase"] + (f" (restart {stage['restarts']})" if stage["restarts"] else "")
            if self._phases.get(stage["name"]) != phase:
                self._phases[stage["name"]] = phase
                self._line(state, f"{stage['name']}: {phase} {stage['why']}")
        silent = list(state.get("silent_s", {}))
        if silent != self._silent:
            self._line(state, silence_text(state) or f"receiving again: {', '.join(self._silent)}")
            self._silent = silent
        current = alarms(state)
        for alarm in current:
            if alarm not in self._alarms:
                self._line(state, f"alarm: {alarm}")
        for alarm in self._alarms:
            if alarm not in current:
                self._line(state, f"no longer: {alarm}")
        self._alarms = current
        mission = state["mission"]
        if mission:
            text = " ".join(
                str(mission[key])
                for key in ("lifecycle_state", "mission_phase", "current_target", "last_event")
                if mission[key]
            )
            text += f" · {mission['tags_discovered']} tags · {mission['targets_completed']}/{mission['targets_total']} read"
            if text != self._last_mission:
                self._last_mission = text
                self._line(state, f"mission: {text}")

    def _line(self, state: dict[str, Any], text: str) -> None:
        self._console.print(f"[{state['age_s']:7.1f} s] {printable(text)}", highlight=False, soft_wrap=True, markup=False)
