"""The operator's requests to a running mission, as verbs of `lupin mission`."""

from __future__ import annotations

import json
from typing import Annotated

import typer

_RUN = typer.Option("--run", help="A part of the run's name, where several are up.")
_GOAL = typer.Option("--discovery-goal", help="Tags to discover: a number, or all; without it the node's own goal.")
_TAGS = typer.Argument(help="Tags to inspect, in this order; without any the robot explores.")

# verb: what it asks for, in a line of help
REQUESTS = {
    "pause": "Hold the mission where it is.",
    "resume": "Go on; needs a released e-stop and a battery that is not low.",
    "abort": "Close what is left as skipped and drive home.",
    "skip": "Leave the current tag of an inspection out.",
    "dock": "Drive home and wait there; resume goes on with the same mission.",
    "reset": "Leave FAULT.",
}


def register(app: typer.Typer) -> None:
    """Add the verbs to `lupin mission`."""
    app.command("start")(_start)
    app.command("status")(_status)
    for verb, text in REQUESTS.items():
        app.command(verb, help=text)(_request(verb))


def _request(verb: str):  # type: ignore[no-untyped-def]
    def ask(run: Annotated[str | None, _RUN] = None) -> None:
        from lupin_cli.graph_session import visit
        from lupin_runtime import graph

        rows = {
            "pause": graph.MISSION_PAUSE,
            "resume": graph.MISSION_RESUME,
            "abort": graph.MISSION_ABORT,
            "skip": graph.MISSION_SKIP,
            "dock": graph.MISSION_DOCK,
            "reset": graph.MISSION_RESET,
        }
        with visit(run) as here:
            from std_srvs.srv import Trigger

            answer = here.call(rows[verb], Trigger.Request())
        _say(answer.success, answer.message or verb)

    return ask


def _start(
    tags: Annotated[list[str] | None, _TAGS] = None,
    discovery_goal: Annotated[str | None, _GOAL] = None,
    run: Annotated[str | None, _RUN] = None,
) -> None:
    """Start a mission on the running stack: an exploration, or an inspection of the tags named.

    Exit status: 0 accepted, 1 refused, with the reason; 3 no run is up.
    """
    from lupin_cli.graph_session import visit
    from lupin_runtime import graph

    with visit(run) as here:
        from lupin_msgs.srv import StartMission

        request = StartMission.Request(mission_type="InspectionMission" if tags else "ExplorationMission")
        request.tag_sequence = list(tags or [])
        request.discovery_goal = goal_count(discovery_goal) if discovery_goal else 0
        answer = here.call(graph.MISSION_START, request)
    _say(answer.accepted, f"mission {answer.mission_id}" if answer.accepted else answer.error_message)


def _status(
    run: Annotated[str | None, _RUN] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Where the mission is. Changes nothing. Exit status: 0 told, 1 no mission in this run, 3 no run is up."""
    from lupin_runtime.stack.runs import RunError, find_live_run

    try:
        mission = find_live_run(run).state().get("mission")
    except RunError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(3) from error
    if not mission:
        typer.echo("this run has no mission process; start one with: lupin up --mission", err=True)
        raise typer.Exit(1)
    if as_json:
        print(json.dumps(mission))
        return
    from rich.console import Console

    from lupin_cli.live import mission_lines

    Console().print(*mission_lines(mission), sep="\n")


def _say(success: bool, text: str) -> None:
    typer.echo(text, err=not success)
    raise typer.Exit(0 if success else 1)


def goal_count(text: str) -> int:
    """The count that `all` or a number of tags stands for. Raises typer.BadParameter."""
    from lupin_runtime.stack.table import ALL_TAGS

    if text == "all":
        return ALL_TAGS
    if text.isdigit() and 0 < int(text) < ALL_TAGS:
        return int(text)
    raise typer.BadParameter(f"{text!r} is neither a number of tags nor 'all'", param_hint="--discovery-goal")
