"""The live view of a run: what the mission does, a map, its processes with the conditions they wait for."""

from __future__ import annotations

import math
from typing import Any

from rich.console import Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from lupin_cli.run.map_drawing import draw_map
from lupin_cli.safe_console import SafeConsole
from lupin_runtime.stack.alarms import alarms

PHASE_STYLE = {"waiting": "dim", "starting": "yellow", "up": "green", "failed": "bold red", "stopped": "dim"}
PHASE_MARK = {"waiting": "·", "starting": "…", "up": "✓", "failed": "✗", "stopped": "–"}

MAX_BEADS = 40
MAX_MAP_HEIGHT, MIN_MAP_HEIGHT, MIN_MAP_WIDTH, MARGIN_ROWS = 22, 6, 78, 4
# What the mission does, by its phase while it has a tag, and else by its state.
_WITH_TAG = {"NAVIGATING": "Driving to", "SCANNING": "Reading", "PUBLISHING": "Reading", "CONFIRMING": "Looking for"}
_WITHOUT_TAG = {
    "BOOT": "Starting",
    "READY": "Ready",
    "PREPARE": "Preparing",
    "EXPLORING": "Exploring",
    "INSPECTING": "Inspecting",
    "MONITORING": "Monitoring",
    "RETURNING": "Returning home",
    "DONE": "Done",
    "FAULT": "Failed",
}

_FAILURES = {"targets_failed": "failed", "targets_unreachable": "unreachable"}


def stage_table(state: dict[str, Any]) -> Table:
    """Return a table of the processes; `state` is the content of `state.json`."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("process", no_wrap=True)
    table.add_column("up after", justify="right", no_wrap=True)
    table.add_column("cpu", justify="right", no_wrap=True)
    table.add_column("memory", justify="right", no_wrap=True)
    table.add_column("", ratio=1)
    for stage in state.get("stages", []):
        phase = stage["phase"]
        style = PHASE_STYLE.get(phase, "")
        note = "" if _ends_run(state, stage) else stage["why"]
        if stage["waiting_for"]:
            note = f"{stage['waiting_s']:.0f} s for {'; '.join(stage['waiting_for'])}"
        if stage["restarts"]:
            note = f"restarted {stage['restarts']}×  {note}"
        engine = f" ({stage['engine']})" if stage.get("engine") else ""
        table.add_row(
            Text(f"{PHASE_MARK.get(phase, ' ')} {stage['name']}{engine}", style=style),
            f"{stage['up_after_s']:.1f} s" if stage["up_after_s"] is not None else "",
            f"{stage['cpu_percent']:.0f} %" if stage["pid"] else "",
            f"{stage['memory_mb']:.0f} MB" if stage["memory_mb"] else "",
            Text(note, style=style),
        )
    return table


def _ends_run(state: dict[str, Any], stage: dict[str, Any]) -> bool:
    """Return whether the run ends because this process has exited: the reason is then the run's result, and stated there."""
    return any(death["ends_run"] and death["stage"] == stage["name"] for death in state.get("deaths", []))


def doing(mission: dict[str, Any]) -> str:
    """Return in a few words what the mission does."""
    tag = mission["current_target"]
    if tag and mission["mission_phase"] in _WITH_TAG:
        return f"{_WITH_TAG[mission['mission_phase']]} tag {tag}"
    state = str(mission["lifecycle_state"])
    return _WITHOUT_TAG.get(state, state)


def mission_lines(mission: dict[str, Any], robot: dict[str, Any] | None = None) -> list[RenderableType]:
    """Return lines on what the mission does, its progress and interruptions; empty without a mission."""
    if not mission:
        return []
    robot = robot or {}
    line = Text()
    if mission["estop_engaged"]:
        line.append("STOPPED", "bold red").append("  the e-stop is engaged; was ")
    if mission["paused"]:
        line.append("Paused  ", "bold yellow")
    line.append(doing(mission), "bold")
    if mission["battery_low"]:
        line.append("  battery low", "bold yellow")
    clock = mission.get("clock_s")
    clock_line = Text(f"mission clock  {clock_text(clock)}" if clock is not None else "")
    way_line = Text(_way_text(robot), style="dim")
    read = max(mission["targets_completed"], sum(tag["read"] for tag in robot.get("tags", ())))
    lines: list[RenderableType] = [_both_ends(line, clock_line), _both_ends(_count_text(mission, read), way_line)]
    if total := max(mission["tags_discovered"], mission["targets_total"]):
        read = min(total, read)
        shown = min(total, MAX_BEADS)
        full = read * shown // total
        lines.append(Text.assemble(("● " * full, "bright_green"), ("○ " * (shown - full), "dim")))
    if mission["last_event"] and mission.get("last_event_severity", 1):
        lines.append(Text(f"last: {mission['last_event']}", style="dim"))
    return lines


def _both_ends(left: Text, right: Text) -> Table:
    line = Table.grid(expand=True)
    line.add_column(ratio=1)
    line.add_column(justify="right", no_wrap=True)
    line.add_row(left, right)
    return line


def _count_text(mission: dict[str, Any], read: int) -> Text:
    """Return the counts, of which none shrinks but that of a round of monitoring, which visits the tags again."""
    if mission["tags_discovered"]:
        counts = [f"{mission['tags_discovered']} discovered"]
    else:  # the tags were given
        counts = [f"{mission['targets_total']} tags"] if mission["targets_total"] else []
    counts.append(f"{read} read")
    if mission["lifecycle_state"] == "MONITORING":
        counts.append(f"{mission['targets_completed']} of {mission['targets_total']} again")
    counts += [f"{mission[name]} {word}" for name, word in _FAILURES.items() if mission[name]]
    return Text(" · ".join(counts))


def clock_text(seconds: float) -> str:
    """Return a duration as minutes and seconds."""
    return f"{int(seconds) // 60}:{int(seconds) % 60:02}"


def _way_text(robot: dict[str, Any]) -> str:
    """Return how far the plan still leads, and the speed; empty if neither is known."""
    parts, pose, plan = [], robot.get("pose"), robot.get("plan")
    if pose and plan:
        # Of a plan that is older than the pose, the part behind the robot is driven.
        nearest = min(range(len(plan)), key=lambda at: math.dist(plan[at], pose[:2]))
        ahead = [pose[:2], *plan[nearest:]]
        parts.append(f"{sum(map(math.dist, ahead, ahead[1:])):.1f} m to go")
    if pose and robot.get("speed_m_s") is not None:
        parts.append(f"{robot['speed_m_s']:.2f} m/s")
    return " at ".join(parts)


def robot_table(robot: dict[str, Any], mission: dict[str, Any], events: list[dict[str, Any]], max_events: int) -> Table:
    """Return a column on the robot and what has happened, beside the map."""
    table = Table.grid(padding=(0, 2), expand=True)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(ratio=1, no_wrap=True, overflow="ellipsis")
    battery = mission.get("battery_percentage") if robot.get("battery") is None else robot["battery"]
    factor, free_m2 = robot.get("real_time_factor"), (robot.get("map") or {}).get("free_m2")
    for name, value in (
        ("battery", f"{100.0 * battery:.0f} %" if battery is not None else ""),
        ("distance", f"{robot['distance_m']:.1f} m" if robot.get("distance_m") is not None else ""),
        ("mapped", f"{free_m2:.1f} m²" if free_m2 is not None else ""),
        ("real time", f"{factor:.2f} x" if factor is not None else ""),
        ("position", _pose_text(robot.get("pose"))),
    ):
        if value:
            table.add_row(name, value)
    if events:
        table.add_row("", "")
    for event in events[: -max_events - 1 : -1]:
        table.add_row(clock_text(event["clock_s"]) if event["clock_s"] is not None else "", Text(event["text"]))
    return table


def _pose_text(pose: list[float] | None) -> str:
    return f"{pose[0]:.2f}, {pose[1]:.2f} m, {math.degrees(pose[2]):.0f}°" if pose else "not known"


def silence_text(state: dict[str, Any]) -> str:
    """Return a warning about topics that have fallen silent; empty if none has."""
    silent: dict[str, float] = state.get("silent_s", {})
    if not silent:
        return ""
    topics = ", ".join(f"{name} for {age:.0f} s" for name, age in silent.items())
    local = " --local" if any(stage["name"] == "sim" for stage in state.get("stages", [])) else ""
    return f"silent: {topics}; find the cause with: lupin doctor{local}"


def _robot(state: dict[str, Any]) -> dict[str, Any]:
    """Return what the state says of the robot; empty if its pose or a point has not the right number of coordinates."""
    robot: dict[str, Any] = state.get("robot") or {}
    points = [*robot.get("plan", ()), *robot.get("trail", ())]
    is_whole = len(robot.get("pose") or (0, 0, 0)) == 3 and all(len(point) == 2 for point in points)
    return robot if is_whole else {}


def run_view(state: dict[str, Any], console: SafeConsole, *, every_process: bool = False) -> Group:
    """Return the complete view of a run: what the mission does, alarms, the map beside the robot's figures, the processes.

    Only a terminal that is large enough shows the map. With `every_process`, the processes are listed also while all are well.
    """
    robot, mission, options = _robot(state), state.get("mission") or {}, console.options
    head = mission_lines(mission, robot)
    head += [Text(f"▲ {alarm}", style="bold red") for alarm in (silence_text(state), *alarms(state)) if alarm]
    foot = [*_processes(state, every_process), _foot(state, one_line=not every_process)]
    used = sum(len(console.render_lines(part, options)) for part in (*head, *foot))
    height = min(MAX_MAP_HEIGHT, console.height - used - MARGIN_ROWS)
    if not console.is_terminal or options.ascii_only or height < MIN_MAP_HEIGHT or console.width < MIN_MAP_WIDTH:
        return Group(*head, *foot)
    width = console.width * 11 // 20
    drawn = draw_map(robot, width, height)
    if not drawn:
        return Group(*head, *foot)
    beside = Table.grid(padding=(0, 2), expand=True)
    beside.add_column(width=width, no_wrap=True)
    beside.add_column(ratio=1)
    beside.add_row(Group(*drawn), robot_table(robot, mission, state.get("events", []), max(0, len(drawn) - 6)))
    return Group(*head, Text(), beside, Text(), *foot)


def _processes(state: dict[str, Any], every_process: bool) -> list[RenderableType]:
    """Return one line while all processes are well, else with a table of those that are not; while they start, of all."""
    stages = state.get("stages", [])
    ill = [stage for stage in stages if stage["phase"] != "up" or stage["waiting_for"] or stage.get("trouble")]
    if every_process or any(stage["up_after_s"] is None for stage in ill) or not stages:
        return [stage_table(state)]
    ready_s = state.get("ready_s")
    ready = f" · ready after {ready_s:.0f} s" if ready_s is not None else ""
    well = Text.assemble(("✓ ", "green"), f"{len(stages) - len(ill)} of {len(stages)} processes up{ready}")
    return [well, stage_table({**state, "stages": ill})] if ill else [well]


def _foot(state: dict[str, Any], *, one_line: bool) -> Text:
    stages = state.get("stages", [])
    memory, cpu = sum(stage["memory_mb"] for stage in stages), sum(stage["cpu_percent"] for stage in stages)
    rates = "  ".join(f"{name} {hz:.1f} Hz" for name, hz in state.get("rates_hz", {}).items() if hz > 0.0)
    run = f"run {state.get('id', '')} · {state.get('age_s', 0.0):.0f} s"
    text = f"{run} · {cpu:.0f} % of a core · {memory:.0f} MB   {rates}"
    return Text(text, style="dim", no_wrap=one_line, overflow="ellipsis")


class Repainter:
    """Paints a view over its last one, for the block. After a change of the terminal's size it begins on an empty screen.

    A terminal wraps what is on it anew when it gets narrower, so that the rows of the last view are no longer known.
    """

    def __init__(self, console: SafeConsole, *, transient: bool = False) -> None:
        self._console = console
        self._transient = transient
        self._size = console.size
        self._live = self._new()

    def _new(self) -> Live:
        return Live(console=self._console, auto_refresh=False, transient=self._transient)

    def __enter__(self) -> Repainter:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def paint(self, view: RenderableType) -> None:
        """Show `view` instead of the last one."""
        if self._console.size != self._size:
            self._size = self._console.size
            self._live.stop()
            self._console.clear()
            self._live = self._new()
            self._live.start()
        self._live.update(view, refresh=True)


class LiveView:
    """Shows the states of a run: repainted on a terminal, one line per change on other outputs."""

    def __init__(self, console: SafeConsole) -> None:
        self._console = console
        can_repaint = console.is_terminal and not console.is_dumb_terminal
        self._repainter = Repainter(console) if can_repaint else None
        self._phases: dict[str, str] = {}
        self._last_mission = ""
        self._silent: list[str] = []
        self._alarms: list[str] = []
        self._calls = 0

    def __enter__(self) -> LiveView:
        if self._repainter is not None:
            self._repainter.__enter__()
        return self

    def __exit__(self, *details: Any) -> None:
        if self._repainter is not None:
            self._repainter.__exit__(*details)

    def show(self, state: dict[str, Any]) -> None:
        """Show the newest state."""
        self._calls += 1
        if self._repainter is not None:
            if self._calls % 3 == 1:  # states arrive ten times a second; about three repaints are enough
                self._repainter.paint(run_view(state, self._console))
            return
        for stage in state["stages"]:
            phase = stage["phase"] + (f" (restart {stage['restarts']})" if stage["restarts"] else "")
            if self._phases.get(stage["name"]) != phase:
                self._phases[stage["name"]] = phase
                why = "" if _ends_run(state, stage) else stage["why"]
                self._line(state, f"{stage['name']}: {phase} {why}".rstrip())
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
            tags = "tag" if mission["tags_discovered"] == 1 else "tags"
            done = "visited again" if mission["lifecycle_state"] == "MONITORING" else "read"
            text += f" · {mission['tags_discovered']} {tags} · {mission['targets_completed']}/{mission['targets_total']} {done}"
            if text != self._last_mission:
                self._last_mission = text
                self._line(state, f"mission: {text}")

    def _line(self, state: dict[str, Any], text: str) -> None:
        self._console.print(f"[{state['age_s']:7.1f} s] {text}", soft_wrap=True)
