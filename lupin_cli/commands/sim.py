"""`lupin sim`: worlds of the simulated robot, pictures and videos of them, its e-stop button, and the simulated computer."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lupin_cli.command_group import command_group
from lupin_cli.commands import sim_host
from lupin_cli.completion import worlds as complete_worlds
from lupin_cli.exit_codes import FAILURE, SUCCESS, USAGE_ERROR
from lupin_cli.run.run_option import LIVE_RUN
from lupin_cli.terminal import echo, work_progress

if TYPE_CHECKING:
    from lupin_sim.flythrough import FilmFrame
    from lupin_sim.world import World

app = command_group(
    "The simulated robot: worlds, pictures, videos, its e-stop button, and the simulated computer.",
    "lupin sim worlds",
    no_args_is_help=True,
)

app.add_typer(sim_host.app, name="host")

_WORLD = typer.Option(
    "--world", autocompletion=complete_worlds, help="demo, course[:STRETCH], random:SEED, walled, or a layout file."
)
_SEED = typer.Option("--seed", help="Select the random world and the random placement of flowers.")
_TRAJECTORY = typer.Option("--trajectory", help="Show the drive of this TUM file (world frame).", dir_okay=False)
_CAMERA = "overview, top, follow, front or gripper."
_LISTED_WORLDS = ("demo", "course", "random:1", "walled")


@app.command()
def worlds(as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False) -> None:
    """List the greenhouses: size, tags, flowers, and how many tags the robot can reach.

    Example: lupin sim worlds
    """
    from lupin_sim.reachability import reachable_tags
    from lupin_sim.worlds import CATALOG, load_world

    rows = []
    for entry, name in zip(CATALOG, _LISTED_WORLDS):
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
        print(json.dumps(rows))
        return
    echo(f"{'WORLD':16}{'SIZE':14}{'TAGS':>5}{'REACHABLE':>11}{'FLOWERS':>9}{'BUGS':>6}  ")
    for row in rows:
        size = f"{row['length_m']:.1f} x {row['breadth_m']:.1f} m"
        counts = f"{row['tags']:>5}{row['tags_reachable']:>11}{row['flowers']:>9}{row['bugs']:>6}"
        echo(f"{row['name']:16}{size:14}{counts}  {row['summary']}")
    echo("your own layout, a file: lupin up --world layout.json")


@app.command()
def picture(
    world: Annotated[str, _WORLD] = "demo",
    seed: Annotated[int, _SEED] = 0,
    camera: Annotated[str, typer.Option("--camera", help=_CAMERA)] = "overview",
    out: Annotated[Path, typer.Option("--out", help="Write this PNG or JPEG.", dir_okay=False)] = Path("picture.png"),
    trajectory: Annotated[Path | None, _TRAJECTORY] = None,
) -> None:
    """Draw a picture of a world, with the robot's path if a trajectory is given.

    Example: lupin sim picture --world walled --camera top --out top.png
    """
    from lupin_sim.rendering import picture as draw

    frames = _recorded_frames(trajectory, 10.0) if trajectory is not None else []
    with work_progress() as show:
        show("drawing", None)
        _report_drawing_errors(lambda: draw(_load(world, seed), out, camera, frames))
    echo(f"wrote {out}")


@app.command()
def video(
    world: Annotated[str, _WORLD] = "demo",
    seed: Annotated[int, _SEED] = 0,
    camera: Annotated[str, typer.Option("--camera", help=_CAMERA)] = "follow",
    out: Annotated[Path, typer.Option("--out", help="Write this MP4 or GIF.", dir_okay=False)] = Path("drive.mp4"),
    trajectory: Annotated[Path | None, _TRAJECTORY] = None,
    rate_hz: Annotated[float, typer.Option("--rate", min=1.0, max=60.0, help="Frames per second of film.")] = 10.0,
    speed: Annotated[float, typer.Option("--speed", min=0.1, max=100.0, help="Seconds of drive per second of film.")] = 1.0,
    limit_s: Annotated[
        float, typer.Option("--limit", min=0.0, help="Limit the film to this many seconds; 0 for no limit.")
    ] = 0.0,
) -> None:
    """Film a drive: along a trajectory, or past every tag that the robot can reach.

    Example: lupin sim video --limit 20 --out walk.mp4
    """
    from lupin_sim.flythrough import flythrough
    from lupin_sim.rendering import film

    greenhouse = _load(world, seed)
    frames_per_s = rate_hz / speed
    frames = _recorded_frames(trajectory, frames_per_s) if trajectory is not None else flythrough(greenhouse, frames_per_s)
    if limit_s > 0.0:
        frames = frames[: max(1, round(limit_s * rate_hz))]
    with work_progress() as show:
        show("drawing", 0.0)
        _report_drawing_errors(
            lambda: film(greenhouse, out, frames, rate_hz, camera, progress=lambda share: show("drawing", share))
        )
    echo(f"wrote {out}: {len(frames)} frames, {len(frames) / rate_hz:.0f} s")


@app.command()
def press(
    button: Annotated[str, typer.Argument(help="The button to press: estop.")] = "estop",
    release: Annotated[bool, typer.Option("--release", help="Release the button; this alone starts no motion.")] = False,
    run: LIVE_RUN = None,
) -> None:
    """Press the simulated robot's e-stop button, or release it.

    Exit status: 0 done, 1 the simulator did not answer, 2 there is no such button, 3 no run is up.

    Example: lupin sim press estop --release
    """
    if button != "estop":
        echo(f"lupin sim: there is no button {button!r}; there is: estop", err=True)
        raise typer.Exit(USAGE_ERROR)
    from lupin_cli.run.ros_client import join_run
    from lupin_runtime import graph

    with join_run(run) as session:
        from std_srvs.srv import SetBool

        answer = session.call(graph.SIM_PRESS_ESTOP, SetBool.Request(data=not release))
    echo(answer.message or f"the e-stop is {'released' if release else 'pressed'}")
    raise typer.Exit(SUCCESS if answer.success else FAILURE)


def _load(name: str, seed: int) -> World:
    from lupin_sim.worlds import WorldError, load_world

    try:
        return load_world(name, seed)
    except WorldError as error:
        echo(f"lupin sim: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from None


def _recorded_frames(path: Path, rate_hz: float) -> list[FilmFrame]:
    from lupin_sim.flythrough import from_trajectory
    from lupin_sim.scoring import read_tum

    try:
        trajectory = read_tum(path)
    except (OSError, ValueError) as error:
        echo(f"lupin sim: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from None
    if len(trajectory) == 0:
        echo(f"lupin sim: {path} contains no poses", err=True)
        raise typer.Exit(USAGE_ERROR)
    return from_trajectory(trajectory, rate_hz)


def _report_drawing_errors(draw: Callable[[], None]) -> None:
    from lupin_sim.cameras import GraphicsUnavailable

    try:
        draw()
    except ValueError as error:
        echo(f"lupin sim: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from None
    except (GraphicsUnavailable, OSError) as error:
        echo(f"lupin sim: {error}", err=True)
        raise typer.Exit(FAILURE) from None
