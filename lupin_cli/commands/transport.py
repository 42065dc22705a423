"""`lupin transport`: the transport in use, how good its link is, and which transport to take."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lupin_cli.command_group import command_group
from lupin_cli.commands import play
from lupin_cli.connection.base import Output, Script, Unreachable
from lupin_cli.connection.inventory import TRANSPORTS, Config, ConfigError, Robot, load
from lupin_cli.connection.options import ASK_SUDO, CONFIG, ROBOT, connect, destinations, reporting_errors, select_robots
from lupin_cli.exit_codes import SUCCESS, UNREACHABLE
from lupin_cli.terminal import echo

if TYPE_CHECKING:
    from lupin_cli.connection.base import Target
    from lupin_cli.connection.ssh import SshTarget
    from lupin_cli.facts.networkmanager import NetworkManager
    from lupin_cli.link.quality import Quality
    from lupin_cli.link.ranking import RankedTransport
    from lupin_cli.link.route import Route

app = command_group("The transport in use, how good its link is, and which transport to take.", "lupin transport")

PLAYBOOKS = {"wired": "demo-wired", "router": "demo-router", "ap": "demo-access-point"}
_JSON = Annotated[bool, typer.Option("--json", help="Print only JSON on standard output.")]
_QUICK = Annotated[bool, typer.Option("--quick", help="Skip the measurements; only read the routes of both machines.")]


@dataclass
class LinkStatus:
    """What was learned about the link to a robot."""

    robot: str
    transport: str = ""  # the one in use; empty if none answers
    address: str = ""
    laptop_route: Route | None = None
    robot_route: Route | None = None
    quality: Quality | None = None
    unknown: list[str] = field(default_factory=list)  # what could not be learned, and why
    ranking: list[RankedTransport] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Return the status as JSON-serializable data; its keys are stable."""
        return {
            "robot": self.robot,
            "transport": self.transport,
            "address": self.address,
            "laptop": asdict(self.laptop_route) if self.laptop_route else None,
            "far": asdict(self.robot_route) if self.robot_route else None,
            "quality": asdict(self.quality) if self.quality else None,
            "unknown": self.unknown,
            "ranking": [
                {
                    "transport": each.transport,
                    "address": each.address,
                    "answers": each.answers,
                    "why": each.reason,
                    "troubles": each.problems,
                }
                for each in self.ranking
            ],
        }


@app.callback(invoke_without_command=True)
def _show_by_default(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        show()


@app.command()
def show(robot: ROBOT = None, config: CONFIG = None, quick: _QUICK = False, as_json: _JSON = False) -> None:
    """Show the transport in use, how good its link is, and how all transports rank today.

    Measuring takes about ten seconds. Exit status: 0 the robot answers, 3 it answers over none of its transports.

    Example: lupin transport show --quick
    """
    with reporting_errors("transport"):
        inventory = load(config)
        one = _select_one(inventory, robot)
        if not (quick or as_json):
            echo("measuring the link, about ten seconds...", err=True)
        status = _inspect(one, inventory, quick)
    if as_json:
        print(json.dumps(status.as_json()))
    else:
        _print(status)
    raise typer.Exit(SUCCESS if status.transport else UNREACHABLE)


@app.command()
def use(
    transport: Annotated[str, typer.Argument(help="wired, router or ap.")],
    robot: ROBOT = None,
    config: CONFIG = None,
    variables: Annotated[list[str] | None, typer.Option("-v", "--var", help="Set a playbook variable: name=value.")] = None,
    hidden: play.HIDDEN = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would change; change nothing.")] = False,
    diff: Annotated[bool, typer.Option("--diff", help="Show how files change.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Answer every question with yes.")] = False,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Move robot and laptop to a transport: plays demo-wired, demo-router or demo-access-point.

    This is a playbook run: it is journaled, can be resumed, and is undone with lupin play --undo.

    Example: lupin transport use wired
    """
    with reporting_errors("transport"):
        if transport not in TRANSPORTS:
            raise ConfigError(f"{transport!r} is not a transport; choose one of {', '.join(TRANSPORTS)}")
        one = _select_one(load(config), robot)
        assignments = list(variables or [])
        address = one.addresses.get(transport)
        if address and not any(word.startswith("robot_ip=") for word in assignments):
            from lupin_cli.connection.destination import parse_destination

            assignments.append(f"robot_ip={parse_destination(address)[1]}")
    play.command(
        PLAYBOOKS[transport],
        dry_run=dry_run,
        diff=diff,
        yes=yes,
        variables=assignments,
        hidden=hidden,
        robot=[one.name] if robot else None,
        config=config,
        ask_sudo=ask_sudo,
    )


def _select_one(inventory: Config, names: list[str] | None) -> Robot:
    """Return the named robot, or the default one. Raises ConfigError if several are named."""
    chosen = select_robots(inventory, names)
    if len(chosen) != 1:
        raise ConfigError("name exactly one robot with --robot")
    return chosen[0]


def _inspect(robot: Robot, config: Config, quick: bool) -> LinkStatus:
    """Find the transport that answers, read the routes of both machines, measure the link unless `quick`, and rank."""
    from lupin_cli.connection.connect import reachability
    from lupin_cli.link.ranking import link_problems, multihoming_problems, rank, roaming_risks

    status = LinkStatus(robot.name)
    places = destinations(robot)
    reachable = reachability(places)
    problems: dict[str, list[str]] = {}
    if any(reachable.values()):
        try:
            with connect(robot, config) as target:
                announced, manager = _read_machines(target, status)
                if not quick and status.laptop_route is not None:
                    from lupin_cli.connection.local import LocalTarget
                    from lupin_cli.link.quality import measure

                    status.quality = measure(target, LocalTarget(), target.peer[0], status.laptop_route.source)
        except Unreachable as error:
            status.unknown.append(str(error))
        else:
            status.transport = target.transport_name or "this address"
            status.address = str(target.destination)
            risks = roaming_risks(manager, status.laptop_route.interface if status.laptop_route else "")
            problems[status.transport] = [
                *link_problems(status.laptop_route, status.robot_route, status.quality, risks),
                *multihoming_problems(robot.name, status.transport, announced),
            ]
    status.ranking = rank({name: str(place) for name, place in places.items()}, reachable, problems)
    return status


def _read_machines(target: SshTarget, status: LinkStatus) -> tuple[list[str], NetworkManager | None]:
    """Store the routes of both machines in `status`; return the robot's announced addresses and the laptop's NetworkManager."""
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.facts import addresses, networkmanager

    robot_ip, laptop_ip = target.peer  # behind a NAT gateway, the robot sees an address other than the laptop's own
    laptop_outputs = _probe(LocalTarget(), robot_ip, Script("manager", networkmanager.PROBE))
    robot_outputs = _probe(target, laptop_ip, Script("addresses", addresses.PROBE))
    status.laptop_route = _route(laptop_outputs["route"], "this machine", status)
    status.robot_route = _route(robot_outputs["route"], "the robot", status)
    announced: list[str] = []
    manager = None
    try:
        announced = [each.address for each in addresses.parse(robot_outputs["addresses"]).announced]
        manager = networkmanager.parse(laptop_outputs["manager"])
    except ValueError as error:
        status.unknown.append(str(error))
    return announced, manager


def _probe(target: Target, other_ip: str, script: Script) -> Mapping[str, Output]:
    from lupin_cli.link.route import route_probe

    return target.batch([Script("route", route_probe(other_ip)), script])


def _route(output: Output, machine: str, status: LinkStatus) -> Route | None:
    from lupin_cli.link.route import parse_route

    try:
        return parse_route(output)
    except ValueError as error:
        status.unknown.append(f"{machine}: {error}")
        return None


def _print(status: LinkStatus) -> None:
    if status.transport:
        echo(f"{status.robot} by {status.transport}: {status.address}")
    for machine, route in (("this machine", status.laptop_route), ("the robot", status.robot_route)):
        if route is not None:
            echo(f"  {machine}: {_route_text(route)}")
    if status.quality is not None:
        echo(f"  {_quality_text(status.quality)}")
    for reason in status.unknown:
        echo(f"  unknown: {reason}")
    echo("transports, best first:")
    for number, ranked in enumerate(status.ranking, 1):
        if not ranked.answers:
            state = "does not answer" if ranked.address else "has no address in the inventory"
        else:
            state = "answers, in use" if ranked.transport == status.transport else "answers, not measured"
        echo(f"{number}. {ranked.transport:7} {ranked.address or '-':28} {state}")
        echo(f"     {ranked.reason}")
        for problem in ranked.problems:
            echo(f"     but {problem}")


def _route_text(route: Route) -> str:
    words = [route.interface, route.source, "cable" if route.radio is None else "radio", f"MTU {route.mtu}"]
    words.append("multicast" if route.multicast else "no multicast")
    if route.gateway:
        words.append(f"through {route.gateway}")
    if route.errors:
        words.append(f"{route.errors} frames lost or corrupt since it came up")
    if route.radio is not None:
        radio = route.radio
        words += [radio.ssid] if radio.ssid else []
        words += [f"{radio.signal_dbm:g} dBm"] if radio.signal_dbm is not None else []
        words += [f"{radio.rate_mbps:g} Mbit/s"] if radio.rate_mbps is not None else []
        words += [f"power save {'on' if radio.power_save else 'off'}"] if radio.power_save is not None else []
    return ", ".join(words)


def _quality_text(quality: Quality) -> str:
    def shown(value: float | None, form: str) -> str:
        return "unknown" if value is None else form.format(value)

    passes = {True: "yes", False: "no", None: "unknown"}
    return (
        f"round trip {shown(quality.rtt_ms, '{:.1f} ms')} (95 %: {shown(quality.rtt_p95_ms, '{:.1f} ms')}), "
        f"jitter {shown(quality.jitter_ms, '{:.1f} ms')}, loss {shown(quality.loss, '{:.0%}')}, "
        f"at least {shown(quality.down_mbps, '{:.0f}')} Mbit/s down and {shown(quality.up_mbps, '{:.0f}')} up, "
        f"multicast down {passes[quality.multicast_down]}, up {passes[quality.multicast_up]}"
    )
