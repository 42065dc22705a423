"""Faults of interfaces, their addresses and MTU, and of routes, at either end or on the link."""

from __future__ import annotations

import random

from bench.faults.fault import (
    ADDRESSES,
    ENDS,
    INTERFACES,
    LAPTOP,
    ROBOT,
    SECOND_INTERFACES,
    Effect,
    Fault,
    Step,
    harmless,
    link_fault,
)


def unplug_link(rng: random.Random) -> Fault:
    """The cable, the switch, or an interface that somebody switched off."""
    what = rng.choice(("cable-cut", "switch-dead", *ENDS))
    if what in ENDS:
        name = INTERFACES[what]
        step = Step(what, f"ip link set {name} down", f"ip link set {name} up")
        return Fault("unplug", f"{what}: {name} down", "cable", "carrier", what, Effect.BREAKS, (step,), hides_robot=True)
    return link_fault("unplug", what, "carrier", Effect.BREAKS, hides_robot=True)


def unplug_address(rng: random.Random) -> Fault:
    """An address that an interface lost, or exchanged for another."""
    machine = rng.choice(ENDS)
    name, address = INTERFACES[machine], f"{ADDRESSES[machine]}/24"
    other = rng.choice(("", f"10.42.{rng.randrange(1, 250)}.{rng.randrange(3, 250)}/24"))
    make, undo = f"ip address del {address} dev {name}", f"ip address replace {address} dev {name}"
    if other:
        make, undo = f"{make}\nip address add {other} dev {name}", f"ip address del {other} dev {name}\n{undo}"
    text = f"{machine}: {name} lost {address}" + (f" for {other}" if other else "")
    return Fault("unplug", text, "cable", "address", machine, Effect.BREAKS, (Step(machine, make, undo),), hides_robot=True)


def unplug_unused(rng: random.Random) -> Fault:
    """The interface of a network that is not in use, or an address and a route that nobody needs."""
    machine = rng.choice(ENDS)
    subnet = f"198.51.100.{rng.randrange(1, 255)}"
    name = INTERFACES[machine]
    step = rng.choice(
        (
            Step(machine, f"ip address add {subnet}/32 dev lo", f"ip address del {subnet}/32 dev lo"),
            Step(machine, f"ip route add {subnet}/32 dev {name}", f"ip route del {subnet}/32 dev {name}"),
            Step(machine, f"ip route add blackhole {subnet}/32", f"ip route del blackhole {subnet}/32"),
            Step(machine, f"ip rule add to {subnet} blackhole", f"ip rule del to {subnet} blackhole"),
        )
    )
    return harmless("edit", f"{machine}: {step.make}", step)


def edit_routes(rng: random.Random) -> Fault:
    """A route or rule at either end that takes the packets to the other end elsewhere."""
    machine = rng.choice(ENDS)
    peer = ADDRESSES[ROBOT if machine == LAPTOP else LAPTOP]
    kind = rng.choice(("blackhole", "unreachable", "prohibit"))
    make, undo = rng.choice(
        (
            (f"ip route add {kind} {peer}/32", f"ip route del {kind} {peer}/32"),
            (f"ip rule add to {peer} {kind}", f"ip rule del to {peer} {kind}"),
            (
                f"ip route add {peer}/32 dev {SECOND_INTERFACES[machine]}",
                f"ip route del {peer}/32 dev {SECOND_INTERFACES[machine]}",
            ),
        )
    )
    return Fault(
        "edit", f"{machine}: {make}", "cable", "route", machine, Effect.BREAKS, (Step(machine, make, undo),), hides_robot=True
    )


def edit_neighbor(rng: random.Random) -> Fault:
    """A permanent ARP entry with the hardware address of nobody, for the other end."""
    machine = rng.choice(ENDS)
    peer = ADDRESSES[ROBOT if machine == LAPTOP else LAPTOP]
    hardware = f"02:00:00:00:{rng.randrange(1, 99):02d}:{rng.randrange(1, 99):02d}"
    make = f"ip neigh replace {peer} lladdr {hardware} dev {INTERFACES[machine]} nud permanent"
    undo = f"ip neigh del {peer} dev {INTERFACES[machine]}"
    return Fault(
        "edit", f"{machine}: {make}", "cable", "address", machine, Effect.BREAKS, (Step(machine, make, undo),), hides_robot=True
    )


def shape_interface(rng: random.Random) -> Fault:
    """A queueing discipline that lets less pass than the data needs."""
    machine, rate = rng.choice(ENDS), rng.choice(("192kbit", "384kbit", "768kbit"))
    make = f"tc qdisc add dev {INTERFACES[machine]} root tbf rate {rate} burst 3000 limit 6000"
    step = Step(machine, make, f"tc qdisc del dev {INTERFACES[machine]} root")
    text = f"{machine}: {make}"
    return Fault("limit", text, "cable", "loss", machine, Effect.MAY_BREAK, (step,), hides_robot=True, also_layer="ports")


def edit_mtu(rng: random.Random) -> Fault:
    """An interface whose largest packet is smaller than the other end's."""
    machine, mtu = rng.choice(ENDS), rng.choice((280, 400, 576, 600, 900))
    name = INTERFACES[machine]
    step = Step(machine, f"ip link set {name} mtu {mtu}", f"ip link set {name} mtu 1500")
    return Fault("edit", f"{machine}: {name} mtu {mtu}", "cable", "mtu", machine, Effect.MAY_BREAK, (step,))
