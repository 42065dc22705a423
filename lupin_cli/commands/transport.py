"""`lupin transport`: what carries the link to the robot, and which transport to take."""

from __future__ import annotations

import json
from dataclasses import asdict, field
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lupin_cli.config import TRANSPORTS, Config, ConfigError, Robot, load
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.robot_options import ASK_SUDO, CONFIG, ROBOT, connect, destinations, reporting, select
from lupin_cli.target.base import Script, Unreachable

if TYPE_CHECKING:
    from lupin_cli.target.ssh import SshTarget
    from lupin_cli.transport import Choice, Quality, Way

app = typer.Typer(
    help="What carries the link to the robot, how good it is, and which transport to take.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

PLAYBOOKS = {"wired": "demo-wired", "router": "demo-router", "ap": "demo-access-point"}
_JSON = Annotated[bool, typer.Option("--json", help="Print JSON, alone on standard output.")]
_QUICK = Annotated[bool, typer.Option("--quick", help="Don't measure: only what the two machines say.")]


@dataclass
class Seen:
    """All that is known of a robot's link."""

    robot: str
    transport: str = ""  # the one in use; empty where none answers
    address: str = ""
    laptop: Way | None = None
    far: Way | None = None
    quality: Quality | None = None
    unknown: list[str] = field(default_factory=list)  # what could not be learnt, and why
    ranking: list[Choice] = field(default_factory=list)


@app.callback(invoke_without_command=True)
def _show_by_default(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        show()


@app.command()
def show(robot: ROBOT = None, config: CONFIG = None, quick: _QUICK = False, as_json: _JSON = False) -> None:
    """What carries the link now, how good it is, and how the transports rank on this machine today.

    Measures for about ten seconds. Exit status: 0 the robot answers, 3 it answers over none of its transports.
    """
    with reporting("transport"):
        found = load(config)
        chosen = select(found, robot)
        if len(chosen) != 1:
            raise ConfigError("one robot at a time")
        if not (quick or as_json):
            typer.echo("measuring the link, about ten seconds...", err=True)
        seen = _look(chosen[0], found, quick)
    if as_json:
        typer.echo(json.dumps(asdict(seen)))
    else:
        _tell(seen)
    raise typer.Exit(0 if seen.transport else 3)


@app.command()
def use(
    transport: Annotated[str, typer.Argument(help="wired, router or ap.")],
    robot: ROBOT = None,
    config: CONFIG = None,
    variables: Annotated[list[str] | None, typer.Option("-v", "--var", help="A variable of the playbook: name=value.")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would change; change nothing.")] = False,
    diff: Annotated[bool, typer.Option("--diff", help="Show how files change.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Answer every question with yes.")] = False,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Put robot and laptop on a transport: plays demo-wired, demo-router or demo-access-point.

    It is a run of `lupin play`: in the journal, resumable, and undone with lupin play --undo.
    """
    with reporting("transport"):
        if transport not in TRANSPORTS:
            raise ConfigError(f"{transport!r} is no transport; there are {', '.join(TRANSPORTS)}")
        chosen = select(load(config), robot)
        given = list(variables or [])
        address = chosen[0].addresses.get(transport)
        if address and not any(word.startswith("robot_ip=") for word in given):
            from lupin_cli.target.destination import parse_destination

            given.append(f"robot_ip={parse_destination(address)[1]}")
    from lupin_cli.commands import play

    play.command(
        PLAYBOOKS[transport],
        list_all=False,
        dry_run=dry_run,
        diff=diff,
        from_step="",
        resume=False,
        undo="",
        yes=yes,
        variables=given,
        robot=[each.name for each in chosen] if robot else None,
        every=False,
        limit=None,
        config=config,
        ask_sudo=ask_sudo,
        as_json=False,
    )


def _look(robot: Robot, config: Config, quick: bool) -> Seen:
    from lupin_cli.target.reach import which_answer
    from lupin_cli.transport import homing_trouble, rank, roam_risk, troubles_of

    seen = Seen(robot.name)
    places = destinations(robot)
    answering = which_answer(places)
    troubles: dict[str, list[str]] = {}
    if any(answering.values()):
        try:
            with connect(robot, config) as target:
                announced, manager = _machines(target, seen)
                if not quick and seen.laptop is not None:
                    from lupin_cli.link_quality import measure
                    from lupin_cli.target.local import LocalTarget

                    seen.quality = measure(target, LocalTarget(), target.peer[0], seen.laptop.source)
        except Unreachable as error:
            seen.unknown.append(str(error))
        else:
            seen.transport = target.transport_name or "this address"
            seen.address = str(target.destination)
            risks = roam_risk(manager, seen.laptop.interface if seen.laptop else "")
            troubles[seen.transport] = [
                *troubles_of(seen.laptop, seen.far, seen.quality, risks),
                *homing_trouble(seen.transport, announced),
            ]
    seen.ranking = rank({name: str(place) for name, place in places.items()}, answering, troubles)
    return seen


def _machines(target: SshTarget, seen: Seen) -> tuple[list[str], Any]:
    """Both ends' interfaces into `seen`; the robot's announced addresses, and this machine's NetworkManager."""
    from lupin_cli.facts import addresses, networkmanager
    from lupin_cli.target.local import LocalTarget
    from lupin_cli.transport import parse_way, way_probe

    peer, own = target.peer
    here = LocalTarget().batch(
        [Script("way", way_probe(peer)), Script("manager", networkmanager.PROBE)],
    )
    # As the robot sees this machine: behind a gateway that is another address than ours.
    there = target.batch([Script("way", way_probe(own)), Script("addresses", addresses.PROBE)])
    announced: list[str] = []
    manager = None
    for name, output in (("this machine", here["way"]), ("the robot", there["way"])):
        try:
            way = parse_way(output)
        except ValueError as error:
            seen.unknown.append(f"{name}: {error}")
            continue
        if name == "the robot":
            seen.far = way
        else:
            seen.laptop = way
    try:
        announced = [each.address for each in addresses.parse(there["addresses"]).announced]
        manager = networkmanager.parse(here["manager"])
    except ValueError as error:
        seen.unknown.append(str(error))
    return announced, manager


def _tell(seen: Seen) -> None:
    if seen.transport:
        typer.echo(f"{seen.robot} by {seen.transport}: {seen.address}")
    for name, way in (("this machine", seen.laptop), ("the robot", seen.far)):
        if way is not None:
            typer.echo(f"  {name}: {_way(way)}")
    if seen.quality is not None:
        typer.echo(f"  {_quality(seen.quality)}")
    for why in seen.unknown:
        typer.echo(f"  unknown: {why}")
    typer.echo("transports, best first today:")
    for number, choice in enumerate(seen.ranking, 1):
        state = "answers" if choice.answers else "does not answer" if choice.address else "has no address in the inventory"
        if choice.answers and choice.transport == seen.transport:
            state = "answers, in use"
        elif choice.answers:
            state = "answers, not measured"
        typer.echo(f"{number}. {choice.transport:7} {choice.address or '-':28} {state}")
        typer.echo(f"     {choice.why}")
        for trouble in choice.troubles:
            typer.echo(f"     but {trouble}")


def _way(way: Way) -> str:
    words = [way.interface, way.source, "cable" if way.radio is None else "radio", f"MTU {way.mtu}"]
    words.append("multicast" if way.multicast else "no multicast")
    if way.gateway:
        words.append(f"through {way.gateway}")
    if way.errors:
        words.append(f"{way.errors} frames lost or spoilt since it came up")
    if way.radio is not None:
        radio = way.radio
        words += [radio.ssid] if radio.ssid else []
        words += [f"{radio.signal_dbm:g} dBm"] if radio.signal_dbm is not None else []
        words += [f"{radio.rate_mbps:g} Mbit/s"] if radio.rate_mbps is not None else []
        words += [f"power save {'on' if radio.power_save else 'off'}"] if radio.power_save is not None else []
    return ", ".join(words)


def _quality(quality: Quality) -> str:
    def shown(value: float | None, form: str) -> str:
        return "unknown" if value is None else form.format(value)

    passes = {True: "yes", False: "no", None: "unknown"}
    return (
        f"round trip {shown(quality.rtt_ms, '{:.1f} ms')} (95 %: {shown(quality.rtt_p95_ms, '{:.1f} ms')}), "
        f"jitter {shown(quality.jitter_ms, '{:.1f} ms')}, loss {shown(quality.loss, '{:.0%}')}, "
        f"at least {shown(quality.down_mbps, '{:.0f}')} Mbit/s down and {shown(quality.up_mbps, '{:.0f}')} up, "
        f"multicast down {passes[quality.multicast_down]}, up {passes[quality.multicast_up]}"
    )
