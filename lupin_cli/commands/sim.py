"""The simulated robot: its worlds, pictures and films of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lupin_cli.commands import sim_host

if TYPE_CHECKING:
    from lupin_sim.tour import Frame
    from lupin_sim.world import World

app = typer.Typer(
    help="The simulated robot: worlds, pictures, films.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

app.add_typer(sim_host.app, name="host")

USAGE_ERROR, FAILED = 2, 1
_WORLD = typer.Option("--world", help="demo, course[:STRETCH], random:SEED, walled, or a layout file.")
_SEED = typer.Option("--seed", help="Which random world, and how its flowers stand.")
_TRAJECTORY = typer.Option("--trajectory", help="A drive to show: a TUM file in the world frame.", dir_okay=False)
_CAMERA = "overview, top, follow, front or gripper."
_LISTED = ("demo", "course", "random:1", "walled")


@app.command()
def worlds(as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False) -> None:
    """List the greenhouses: size, tags, flowers, and how many tags can be reached."""
    from lupin_sim.reach import reachable_tags
    from lupin_sim.worlds import CATALOGUE, load_world

    rows = []
    for entry, name in zip(CATALOGUE, _LISTED):
        world = load_world(name)
        length, breadth = world.size_m
        rows.append(
            {
                "name": f"{entry.name}:{entry.argument}" if entry.argument else entry.name,
                "example": name,
                "length_m": round(length, 2),
                "breadth_m": round(breadth, 2),
                "planters": sum(box.kind == "planter" for box in world.boxes),
                "tags": len(world.tags),
                "tags_reachable": len(reachable_tags(world)),
                "flowers": len(world.flowers),
                "bugs": sum(flower.bug for flower in world.flowers),
                "summary": entry.summary,
            }
        )
    if as_json:
        typer.echo(json.dumps(rows))
        return
    typer.echo(f"{'WORLD':16}{'SIZE':14}{'TAGS':>5}{'REACHABLE':>11}{'FLOWERS':>9}{'BUGS':>6}  ")
    for row in rows:
        size = f"{row['length_m']:.1f} x {row['breadth_m']:.1f} m"
        counts = f"{row['tags']:>5}{row['tags_reachable']:>11}{row['flowers']:>9}{row['bugs']:>6}"
        typer.echo(f"{row['name']:16}{size:14}{counts}  {row['summary']}")
    typer.echo("FILE.json       a layout of your own: lupin up --world FILE.json")


@app.command()
def picture(
    world: Annotated[str, _WORLD] = "demo",
    seed: Annotated[int, _SEED] = 0,
    camera: Annotated[str, typer.Option("--camera", help=_CAMERA)] = "overview",
    out: Annotated[Path, typer.Option("--out", help="PNG or JPEG to write.", dir_okay=False)] = Path("picture.png"),
    trajectory: Annotated[Path | None, _TRAJECTORY] = None,
) -> None:
    """Draw a picture of a world, with the way the robot drove if a trajectory is given."""
    from lupin_sim.picture import picture as draw

    frames = _recorded(trajectory, 10.0) if trajectory is not None else []
    _drawing(lambda: draw(_load(world, seed), out, camera, frames))
    typer.echo(f"wrote {out}")


@app.command()
def video(
    world: Annotated[str, _WORLD] = "demo",
    seed: Annotated[int, _SEED] = 0,
    camera: Annotated[str, typer.Option("--camera", help=_CAMERA)] = "follow",
    out: Annotated[Path, typer.Option("--out", help="MP4 or GIF to write.", dir_okay=False)] = Path("drive.mp4"),
    trajectory: Annotated[Path | None, _TRAJECTORY] = None,
    rate_hz: Annotated[float, typer.Option("--rate", min=1.0, max=60.0, help="Pictures per second of film.")] = 10.0,
    speed: Annotated[float, typer.Option("--speed", min=0.1, max=100.0, help="Seconds of drive per second of film.")] = 1.0,
    limit_s: Annotated[float, typer.Option("--limit", min=0.0, help="Seconds of film; 0 for all.")] = 0.0,
) -> None:
    """Film a drive: along a trajectory, or past every tag that can be reached."""
    from lupin_sim.picture import film
    from lupin_sim.tour import tour

    greenhouse = _load(world, seed)
    per_s = rate_hz / speed
    frames = _recorded(trajectory, per_s) if trajectory is not None else tour(greenhouse, per_s)
    if limit_s > 0.0:
        frames = frames[: max(1, round(limit_s * rate_hz))]
    _drawing(lambda: film(greenhouse, out, frames, rate_hz, camera))
    typer.echo(f"wrote {out}: {len(frames)} pictures, {len(frames) / rate_hz:.0f} s")


@app.command()
def press(
    button: Annotated[str, typer.Argument(help="The button: estop.")] = "estop",
    release: Annotated[bool, typer.Option("--release", help="Let it go again; nothing starts by that.")] = False,
    run: Annotated[str | None, typer.Option("--run", help="A part of the run's name, where several are up.")] = None,
) -> None:
    """Press the simulated robot's red button, or let it go.

    Exit status: 0 done, 1 the simulator did not answer, 2 no such button, 3 no run is up.
    """
    if button != "estop":
        typer.echo(f"lupin sim: the robot has no button {button!r}; it has: estop", err=True)
        raise typer.Exit(USAGE_ERROR)
    from lupin_cli.graph_session import visit
    from lupin_runtime import graph

    with visit(run) as here:
        from std_srvs.srv import SetBool

        answer = here.call(graph.SIM_PRESS_ESTOP, SetBool.Request(data=not release))
    typer.echo(answer.message or f"the e-stop is {'released' if release else 'pressed'}")
    raise typer.Exit(0 if answer.success else FAILED)


def _load(name: str, seed: int) -> World:
    from lupin_sim.worlds import WorldError, load_world

    try:
        return load_world(name, seed)
    except WorldError as error:
        typer.echo(f"lupin sim: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from None


def _recorded(path: Path, rate_hz: float) -> list[Frame]:
    from lupin_sim.scoring import read_tum
    from lupin_sim.tour import from_trajectory

    try:
        trajectory = read_tum(path)
    except (OSError, ValueError) as error:
        typer.echo(f"lupin sim: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from None
    if len(trajectory) == 0:
        typer.echo(f"lupin sim: {path} holds no poses", err=True)
        raise typer.Exit(USAGE_ERROR)
    return from_trajectory(trajectory, rate_hz)


def _drawing(draw: Callable[[], None]) -> None:
    from lupin_sim.cameras import GraphicsUnavailable

    try:
        draw()
    except ValueError as error:
        typer.echo(f"lupin sim: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from None
    except (GraphicsUnavailable, OSError) as error:
        typer.echo(f"lupin sim: {error}", err=True)
        raise typer.Exit(FAILED) from None
