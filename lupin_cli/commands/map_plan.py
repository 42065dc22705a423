"""`lupin map plan`: the shortest path through a saved map; `lupin map` takes it in."""

from __future__ import annotations

import json
import math
from pathlib import Path

import typer


def _point(text: str, option: str) -> tuple[float, float]:
    """Two finite numbers with a comma between them, or a usage error."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        typer.echo(f"{option}: expected X,Y in metres such as 1.5,-0.3, found {text!r}", err=True)
        raise typer.Exit(2)
    return x, y


def plan(
    map_file: Path = typer.Argument(..., metavar="MAP.yaml", help="A map as map_server and slam_toolbox save it."),
    start: str = typer.Option(..., "--from", metavar="X,Y", help="Where from, metres in the map's frame."),
    goal: str = typer.Option(..., "--to", metavar="X,Y", help="Where to."),
    radius: float = typer.Option(0.22, "--radius", help="What the path keeps from every occupied cell, m."),
    tolerance: float = typer.Option(0.0, "--tolerance", help="End within this of a goal that can't be reached, m."),
    unknown: bool = typer.Option(True, "--unknown/--no-unknown", help="Whether unknown cells may be entered."),
    as_json: bool = typer.Option(False, "--json", help="Print one JSON object, alone on standard output."),
) -> None:
    """Find the shortest path of a disc through a map.

    Occupied cells are solid squares; the path is made of straight lines of any angle. `planning_ms` counts everything but
    reading the file. Exit status: 0 found, 1 there is none, 2 usage or a map that can't be read.
    """
    import time

    from lupin_runtime.navigation.planning import NoPath
    from lupin_runtime.navigation.planning.shortest import shortest
    from lupin_runtime.slam.files import MalformedFile
    from lupin_runtime.slam.map_io import load_map

    ends = _point(start, "--from"), _point(goal, "--to")
    for name, value in (("--radius", radius), ("--tolerance", tolerance)):
        if not (math.isfinite(value) and value >= 0.0):
            typer.echo(f"{name}: expected metres, 0 or more, found {value}", err=True)
            raise typer.Exit(2)
    try:
        grid = load_map(map_file)
    except MalformedFile as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(2) from error
    except OSError as error:
        typer.echo(f"{map_file}: {error.strerror or error}; expected a map's YAML file", err=True)
        raise typer.Exit(2) from error
    began = time.perf_counter()
    try:
        found = shortest(grid, *ends, radius, tolerance, unknown)
    except ValueError as error:
        typer.echo(f"--radius: {error}", err=True)
        raise typer.Exit(2) from error
    except NoPath as refusal:
        spent_ms = (time.perf_counter() - began) * 1e3
        if as_json:
            print(json.dumps({"length_m": None, "path": [], "planning_ms": round(spent_ms, 3), "reason": str(refusal)}))
        typer.echo(str(refusal), err=True)
        raise typer.Exit(1) from refusal
    spent_ms = (time.perf_counter() - began) * 1e3
    if as_json:
        path = [[round(float(x), 4), round(float(y), 4)] for x, y in found.points]
        print(json.dumps({"length_m": round(found.length_m, 4), "path": path, "planning_ms": round(spent_ms, 3)}))
        return
    typer.echo(f"{found.length_m:.2f} m, {len(found.points) - 1} straight parts, planned in {spent_ms:.1f} ms")
    for x, y in found.points:
        typer.echo(f"{x:9.3f} {y:9.3f}")
