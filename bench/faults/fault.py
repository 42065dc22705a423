"""A generated fault: the commands that make and undo it, and where its root lies. Here is what faults are composed from."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum

LAPTOP, ROBOT, LINK = "laptop", "robot", "link"
ENDS = (LAPTOP, ROBOT)
HOST = "host"  # where a step runs: not a shell script, but a fault of `lupin sim host fault`

# The layers of a diagnosis (docs/doctor.md) that a shell command can break, lowest first.
LAYERS = (
    *("carrier", "address", "route", "mtu", "loss", "ports", "login", "machine", "clock", "release", "processes"),
    *("shared-memory", "discovery", "profile", "environment"),
)

ADDRESSES = {LAPTOP: "10.42.0.2", ROBOT: "10.42.0.1"}
INTERFACES = {LAPTOP: "lan0", ROBOT: "eth0"}
SECOND_INTERFACES = {LAPTOP: "wifi0", ROBOT: "wlan0"}  # on the access point's network, which is not in use
SERVER_PORT = 11811
PROFILE = '"$HOME"/.config/lupin/fastdds_super_client.xml'
INVENTORY = '"$HOME"/.config/lupin/lupin.toml'
SSH = '"$HOME"/.ssh'


STACK_UNITS = ("mirte-ros", "lupin-onboard")

# A discovery server that a fix started does not belong to the unit, and would keep the port.
RESTART_STACK = (
    "systemctl reset-failed mirte-ros lupin-onboard 2>/dev/null || true\npkill -x fast-discovery- || true\n"
    "systemctl restart mirte-ros"
)


class Effect(Enum):
    """What a fault does to an operator, as far as that follows from what it touches. Ground truth decides in each case."""

    BREAKS = "breaks"
    MAY_BREAK = "may break"  # it depends on an amount, on the time, or on what the operator does next
    NOTHING = "nothing"  # it touches only what no operator uses: a diagnosis must not name it


@dataclass(frozen=True)
class Step:
    """One change: where it runs, what makes it, and what takes it back. Both are scripts of `sh -e`, run as root.

    With `where` HOST both are the name and settings of a fault of `lupin sim host fault`, as one types them.
    """

    where: str
    make: str
    undo: str


@dataclass(frozen=True)
class Fault:
    """One fault. `layer` and `machine` are where its root lies; both are empty if it has no effect.

    also_layer: a second layer that is as right, such as that of packet filters for one that drops a fraction of all packets.
    part: what it touches. Two faults of the same part can hide or undo each other.
    variables: changes to the environment of the operator's shell; None unsets a variable.
    hides_robot: while it lasts, nothing on the robot can be examined.
    restarts: it restarts services of the robot, which need time to settle.
    """

    verb: str
    text: str
    part: str
    layer: str
    machine: str
    effect: Effect
    steps: tuple[Step, ...] = ()
    variables: tuple[tuple[str, str | None], ...] = ()
    hides_robot: bool = False
    restarts: bool = False
    also_layer: str = ""


Builder = Callable[[random.Random], Fault]


def harmless(verb: str, text: str, *steps: Step, variables: tuple[tuple[str, str | None], ...] = ()) -> Fault:
    """Return a fault without an effect, which a diagnosis must not name."""
    return Fault(verb, text, f"unused: {text}", "", "", Effect.NOTHING, steps, variables)


def link_fault(verb: str, words: str, layer: str, effect: Effect, *, hides_robot: bool = False) -> Fault:
    """Return a fault of the link itself. `words` are the name and settings of a fault of `lupin sim host fault`."""
    step = Step(HOST, f"{words} link=eth0", f"{words.split()[0]} link=eth0")
    return Fault(verb, f"link: {words}", "cable", layer, LINK, effect, (step,), hides_robot=hides_robot)


def filter_step(machine: str, hook: str, name: str, rule: str) -> Step:
    """Return the step that adds a table with one rule of nft to a machine; `hook` is input or output."""
    chain = f"{{ type filter hook {hook} priority -5; policy accept; }}"
    make = f"nft add table inet {name}\nnft 'add chain inet {name} packets {chain}'\nnft 'add rule inet {name} packets {rule}'"
    return Step(machine, make, f"nft delete table inet {name}")


def interface_match(machine: str, hook: str, interfaces: Mapping[str, str] = INTERFACES) -> str:
    """Return the nft words that match packets of the machine's interface of the cable, or of another one."""
    return f'{"iifname" if hook == "input" else "oifname"} "{interfaces[machine]}"'


def table_name(rng: random.Random) -> str:
    """Return a name that says nothing about the fault."""
    return f"t{rng.randrange(10**6)}"


def drop_in(verb: str, unit: str, text: str, layer: str, what: str, effect: Effect = Effect.BREAKS) -> Fault:
    """Return a fault that changes a unit of the robot by a file beside the unit's own, and restarts it."""
    folder = f"/etc/systemd/system/{unit}.service.d"
    file = f"{folder}/local.conf"
    make = f"mkdir -p {folder}\nprintf '{text}\\n' > {file}\nsystemctl daemon-reload\nsystemctl restart --no-block {unit}"
    revive = RESTART_STACK if unit == "mirte-ros" else f"systemctl reset-failed {unit} || true\nsystemctl restart {unit}"
    undo = f"rm -f {file}\nsystemctl daemon-reload\n{revive}"
    return Fault(verb, f"robot: {unit}: {what}", "stack", layer, ROBOT, effect, (Step(ROBOT, make, undo),), restarts=True)


def file_step(where: str, path: str, change: str, after: str = "") -> Step:
    """Keep a copy of a file or folder, and change it; undo moves the copy back. {path} in `change` is the quoted path.

    `after` runs behind the change and behind its undo.
    """
    kept = f"{path}.before-fault"
    make = f"cp -a {path} {kept}\n{change.replace('{path}', path)}\n{after}"
    return Step(where, make.strip(), f"rm -rf {path}\nmv {kept} {path}\n{after}".strip())


def rename_step(where: str, path: str, after: str = "") -> Step:
    """Return the step that gives a file or folder another name; `after` runs behind the change and behind its undo."""
    away = f"{path}.away"
    make, undo = f"mv {path} {away}", f"mv {away} {path}"
    return Step(where, f"{make}\n{after}".strip(), f"{undo}\n{after}".strip())
