"""The mission of a run: start, hold and end it, and draw its state machine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from lupin_runtime.graph import Service

app = typer.Typer(
    help="Start, pause, resume or abort a mission; draw its state machine.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

USAGE_ERROR, REFUSED, NO_RUN = 2, 1, 3
ALL_TAGS = 65535  # StartMission's largest goal: all that can be found

_RUN = Annotated[str | None, typer.Option("--run", help="A part of the run's name, where several are up.")]
_JSON = Annotated[bool, typer.Option("--json", help="Print JSON, alone on standard output.")]


@app.command()
def diagram(
    form: Annotated[str, typer.Option("--format", "-f", help="mermaid, dot, svg or ascii.")] = "mermaid",
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File to write; else standard output.")] = None,
) -> None:
    """Draw the mission's state machine from its definition. Needs no run and no ROS."""
    from lupin_runtime.mission.diagram import FORMATS
    from lupin_runtime.mission.hsm import build_hsm_spec

    if form not in FORMATS:
        typer.echo(f"there is no format {form!r}; there are: {', '.join(FORMATS)}", err=True)
        raise typer.Exit(USAGE_ERROR)
    text = FORMATS[form](build_hsm_spec())
    if out is None:
        typer.echo(text, nl=False)
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        typer.echo(f"cannot write {out}: {error.strerror}", err=True)
        raise typer.Exit(REFUSED) from error
    typer.echo(f"wrote {out}")


def _goal(text: str) -> int:
    if text == "all":
        return ALL_TAGS
    if not text.isdigit() or not 0 < int(text) <= ALL_TAGS:
        typer.echo(f"--discovery-goal is {text!r}, expected a number from 1 to {ALL_TAGS}, or all", err=True)
        raise typer.Exit(USAGE_ERROR)
    return int(text)


@app.command()
def start(
    tags: Annotated[list[str] | None, typer.Argument(help="Tags to inspect, in this order.")] = None,
    inspect: Annotated[bool, typer.Option("--inspect", help="Inspect all known tags instead of exploring.")] = False,
    discovery_goal: Annotated[
        str | None, typer.Option("--discovery-goal", help="How many tags to look for, or all; else as the run was started.")
    ] = None,
    run: _RUN = None,
    as_json: _JSON = False,
) -> None:
    """Start a mission on a run that is up: an exploration, or with tags (or --inspect) an inspection.

    Exit status: 0 accepted, 1 refused, 2 usage, 3 no run is up.
    """
    inspection = inspect or bool(tags)
    if inspection and discovery_goal is not None:
        typer.echo("--discovery-goal is for an exploration; leave out the tags and --inspect", err=True)
        raise typer.Exit(USAGE_ERROR)
    goal = 0 if discovery_goal is None else _goal(discovery_goal)
    from lupin_cli.graph_session import visit

    with visit(run) as graph_visit:
        from lupin_msgs.srv import StartMission

        from lupin_runtime import graph

        request = StartMission.Request(
            mission_type="InspectionMission" if inspection else "ExplorationMission",
            tag_sequence=list(tags or ()),
            discovery_goal=goal,
        )
        answer = graph_visit.call(graph.MISSION_START, request)
    _report(bool(answer.accepted), answer.error_message or f"started {answer.mission_id}", as_json, answer.mission_id)


def _report(success: bool, message: str, as_json: bool, mission_id: str = "") -> None:
    if as_json:
        typer.echo(json.dumps({"success": success, "message": message, "mission_id": mission_id}))
    else:
        typer.echo(message, err=not success)
    if not success:
        raise typer.Exit(REFUSED)


def _ask(service: Service, run: str | None, as_json: bool) -> None:
    """Call a Trigger service of the mission and report its answer."""
    from lupin_cli.graph_session import visit

    with visit(run) as graph_visit:
        from std_srvs.srv import Trigger

        answer = graph_visit.call(service, Trigger.Request())
    _report(bool(answer.success), answer.message, as_json)


@app.command()
def pause(run: _RUN = None, as_json: _JSON = False) -> None:
    """Hold the mission where it is. Exit status: 0 done, 1 refused, 3 no run is up."""
    from lupin_runtime import graph

    _ask(graph.MISSION_PAUSE, run, as_json)


@app.command()
def resume(run: _RUN = None, as_json: _JSON = False) -> None:
    """Go on: with what was held, or from the dock with what was left. Exit status as pause."""
    from lupin_runtime import graph

    _ask(graph.MISSION_RESUME, run, as_json)


@app.command()
def abort(run: _RUN = None, as_json: _JSON = False) -> None:
    """End the mission and drive home; a second time, end it at once. Exit status as pause."""
    from lupin_runtime import graph

    _ask(graph.MISSION_ABORT, run, as_json)


@app.command()
def skip(run: _RUN = None, as_json: _JSON = False) -> None:
    """Give up the current tag of an inspection. Exit status as pause."""
    from lupin_runtime import graph

    _ask(graph.MISSION_SKIP, run, as_json)


@app.command()
def dock(run: _RUN = None, as_json: _JSON = False) -> None:
    """Drive home and wait there; resume comes back to what was left. Exit status as pause."""
    from lupin_runtime import graph

    _ask(graph.MISSION_DOCK, run, as_json)


@app.command()
def reset(run: _RUN = None, as_json: _JSON = False) -> None:
    """Leave FAULT. Exit status as pause."""
    from lupin_runtime import graph

    _ask(graph.MISSION_RESET, run, as_json)


@app.command()
def status(run: _RUN = None, as_json: _JSON = False) -> None:
    """Where the mission is. Exit status: 0 there is one, 1 the run has none, 3 no run is up."""
    from lupin_runtime.stack.runs import RunError, find_live_run

    try:
        mission = find_live_run(run).state().get("mission") or {}
    except RunError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(NO_RUN) from error
    if as_json:
        typer.echo(json.dumps(mission))
    elif mission:
        for line in describe(mission):
            typer.echo(line)
    else:
        typer.echo("this run has no mission; start one with: lupin up --mission", err=True)
    if not mission:
        raise typer.Exit(REFUSED)


def describe(mission: dict[str, object]) -> list[str]:
    """What `lupin mission status` prints of a mission's state; the keys are MissionState's."""
    flags = [
        word
        for key, word in (("estop_engaged", "e-stop"), ("paused", "paused"), ("battery_low", "battery low"))
        if mission.get(key)
    ]
    place = "  ".join(str(mission[key]) for key in ("lifecycle_state", "mission_phase") if mission.get(key))
    lines = [place + (f"  [{', '.join(flags)}]" if flags else "")]
    if mission.get("mission_type"):
        lines.append(f"mission   {mission['mission_type']} {mission.get('mission_id', '')}")
    if mission.get("current_target"):
        lines.append(f"target    tag {mission['current_target']}")
    if mission.get("discovery_goal"):
        goal = "all" if mission["discovery_goal"] == ALL_TAGS else mission["discovery_goal"]
        lines.append(f"found     {mission.get('tags_discovered', 0)} of {goal}")
    if mission.get("targets_total"):
        ends = ("completed", "failed", "unreachable", "skipped")
        tallies = ", ".join(f"{mission.get(f'targets_{end}', 0)} {end}" for end in ends)
        lines.append(f"tags      {mission['targets_total']}: {tallies}")
    if mission.get("last_event"):
        lines.append(f"last      {mission['last_event']} ({mission.get('last_error', '')})")
    return lines
