"""The verbs of `lupin mission` that send requests to a running mission."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from lupin_cli.exit_codes import FAILURE, SUCCESS, UNREACHABLE
from lupin_cli.run.run_option import LIVE_RUN
from lupin_cli.terminal import echo

_GOAL = typer.Option("--discovery-goal", help="Number of tags to discover, or all; without it the mission node's default.")
_TAGS = typer.Argument(help="Tags to inspect, in this order; without tags the robot explores.")

# verb: its help text
REQUESTS = {
    "pause": "Pause the mission.",
    "resume": "Resume the mission; needs a released e-stop and a charged battery.",
    "abort": "Skip the remaining tags and return to the dock.",
    "skip": "Skip the current tag of an inspection.",
    "dock": "Return to the dock and wait; resume continues the same mission.",
    "reset": "Leave the state FAULT.",
}


def register(app: typer.Typer) -> None:
    """Add the verbs to `lupin mission`."""
    app.command("start")(_start)
    app.command("status")(_status)
    for verb, text in REQUESTS.items():
        app.command(verb, help=f"{text}\n\nExample: lupin mission {verb}")(_request(verb))


def _request(verb: str):  # type: ignore[no-untyped-def]
    def send(run: LIVE_RUN = None) -> None:
        from lupin_cli.run.ros_client import join_run
        from lupin_runtime import graph

        rows = {
            "pause": graph.MISSION_PAUSE,
            "resume": graph.MISSION_RESUME,
            "abort": graph.MISSION_ABORT,
            "skip": graph.MISSION_SKIP,
            "dock": graph.MISSION_DOCK,
            "reset": graph.MISSION_RESET,
        }
        with join_run(run) as session:
            from std_srvs.srv import Trigger

            response = session.call(rows[verb], Trigger.Request())
        _finish(response.success, response.message or verb)

    return send


def _start(
    tags: Annotated[list[str] | None, _TAGS] = None,
    discovery_goal: Annotated[str | None, _GOAL] = None,
    run: LIVE_RUN = None,
) -> None:
    """Start a mission on the running stack: an exploration, or an inspection of the given tags.

    Exit status: 0 accepted, 1 refused (the reason is printed), 3 no run is up.

    Example: lupin mission start 5 11 19
    """
    from lupin_cli.run.ros_client import join_run
    from lupin_runtime import graph

    with join_run(run) as session:
        from lupin_msgs.srv import StartMission

        request = StartMission.Request(mission_type="InspectionMission" if tags else "ExplorationMission")
        request.tag_sequence = list(tags or [])
        request.discovery_goal = goal_count(discovery_goal) if discovery_goal else 0
        response = session.call(graph.MISSION_START, request)
    _finish(response.accepted, f"mission {response.mission_id}" if response.accepted else response.error_message)


def _status(
    run: LIVE_RUN = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show the mission's state. Changes nothing. Exit status: 0 shown, 1 no mission in this run, 3 no run is up.

    Example: lupin mission status --json
    """
    from lupin_runtime.stack.runs import RunError, find_live_run

    try:
        mission = find_live_run(run).state().get("mission")
    except RunError as error:
        echo(str(error), err=True)
        raise typer.Exit(UNREACHABLE) from error
    if not mission:
        echo("this run has no mission process; start one with: lupin up --mission", err=True)
        raise typer.Exit(FAILURE)
    if as_json:
        print(json.dumps(mission))
        return
    from lupin_cli.run.live_view import mission_lines
    from lupin_cli.safe_console import SafeConsole

    SafeConsole().print(*mission_lines(mission), sep="\n")


def _finish(success: bool, text: str) -> None:
    echo(text, err=not success)
    raise typer.Exit(SUCCESS if success else FAILURE)


def goal_count(text: str) -> int:
    """Parse a discovery goal: a number of tags, or `all`. Raises typer.BadParameter."""
    from lupin_runtime.stack.options import ALL_TAGS

    if text == "all":
        return ALL_TAGS
    if text.isdigit() and 0 < int(text) < ALL_TAGS:
        return int(text)
    raise typer.BadParameter(f"{text!r} is neither a number of tags nor 'all'", param_hint="--discovery-goal")
