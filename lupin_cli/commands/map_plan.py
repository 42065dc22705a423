"""`lupin map plan`: the shortest path through a saved map."""

from __future__ import annotations

import json
import math
from pathlib import Path

import typer

from lupin_cli import user_path
from lupin_cli.exit_codes import FAILURE, USAGE_ERROR
from lupin_cli.terminal import echo


def _point(text: str, option: str) -> tuple[float, float]:
    """Parse X,Y. Exits with a usage error unless both are finite numbers."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        echo(f"{option}: expected X,Y in meters such as 1.5,-0.3, found {text!r}", err=True)
        raise typer.Exit(USAGE_ERROR)
    return x, y


def plan(
    map_file: Path = typer.Argument(
        ..., metavar="MAP.yaml", parser=user_path.path, help="A map as map_server and slam_toolbox save it."
    ),
    start: str = typer.Option(..., "--from", metavar="X,Y", help="Start, meters in the map's frame."),
    goal: str = typer.Option(..., "--to", metavar="X,Y", help="Goal, meters in the map's frame."),
    radius: float = typer.Option(0.22, "--radius", help="The path's minimum distance from occupied cells, m."),
    tolerance: float = typer.Option(0.0, "--tolerance", help="How far from an unreachable goal the path may end, m."),
    unknown: bool = typer.Option(True, "--unknown/--no-unknown", help="Allow paths through unknown cells."),
    as_json: bool = typer.Option(False, "--json", help="Print only one JSON object on standard output."),
) -> None:
    """Find the shortest path of a disc through a map.

    Occupied cells are solid squares; the path is made of straight lines of any angle. `planning_ms` counts everything but
    reading the file. Exit status: 0 found, 1 there is no path, 2 usage error or an unreadable map.

    Example: lupin map plan map.yaml --from 0,0 --to 2,1
    """
    import time

    from lupin_runtime.atomic_file import MalformedFile
    from lupin_runtime.navigation.planning import NoPath
    from lupin_runtime.navigation.planning.shortest_path import find_shortest_path
    from lupin_runtime.slam.map_io import load_map

    endpoints = _point(start, "--from"), _point(goal, "--to")
    for name, value in (("--radius", radius), ("--tolerance", tolerance)):
        if not (math.isfinite(value) and value >= 0.0):
            echo(f"{name}: expected meters, 0 or more, found {value}", err=True)
            raise typer.Exit(USAGE_ERROR)
    try:
        grid = load_map(map_file, warn=lambda text: echo(text, err=True))
    except MalformedFile as error:
        echo(str(error), err=True)
        raise typer.Exit(USAGE_ERROR) from error
    except OSError as error:
        echo(f"{map_file}: {error.strerror or error}; expected a map's YAML file", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    began = time.perf_counter()
    try:
        found = find_shortest_path(grid, *endpoints, radius, tolerance, unknown)
    except ValueError as error:
        echo(f"--radius: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error
    except NoPath as error:
        spent_ms = (time.perf_counter() - began) * 1e3
        if as_json:
            print(json.dumps({"length_m": None, "path": [], "planning_ms": round(spent_ms, 3), "reason": str(error)}))
        echo(str(error), err=True)
        raise typer.Exit(FAILURE) from error
    spent_ms = (time.perf_counter() - began) * 1e3
    if as_json:
        path = [[round(float(x), 4), round(float(y), 4)] for x, y in found.points]
        print(json.dumps({"length_m": round(found.length_m, 4), "path": path, "planning_ms": round(spent_ms, 3)}))
        return
    echo(f"{found.length_m:.2f} m, {len(found.points) - 1} straight segments, planned in {spent_ms:.1f} ms")
    for x, y in found.points:
        echo(f"{x:9.3f} {y:9.3f}")
