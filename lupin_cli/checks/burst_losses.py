"""On which machine the packets of a burst were lost, and whether they were lost whatever their port. Pure."""

from __future__ import annotations

import re

from lupin_cli.link.path import DOWN, SMALL_BYTES, UP, Burst, End, Path

PASSES, LOST = 0.95, 0.1  # shares of packets: a layer that delivers more works; one that delivers less passes nothing
MOSTLY_LOST = 0.5
LIMITED = 0.2
LATE_MS = 100.0  # drive commands come every 50 ms
TO = {UP: "from the laptop to the robot", DOWN: "from the robot to the laptop"}
# Rules of nft and iptables that take some of the packets: above a rate, or at random.
TAKES_SOME = re.compile(r"\budp\b.*(limit rate over|numgen random)|-p udp .*(hashlimit|--limit|statistic)")


def shaped_end(path: Path) -> End | None:
    """Return the end that delays, drops or limits on purpose what leaves it; None if neither does, or both do."""
    shaped = [end for end in (path.laptop, path.robot) if end is not None and end.shaping]
    return shaped[0] if len(shaped) == 1 else None


def small_burst(path: Path, direction: str) -> Burst | None:
    """Return the burst of small packets to free ports."""
    return next((burst for burst in path.of(direction, SMALL_BYTES) if burst.arrived is not None), None)


def losing_machine(path: Path, burst: Burst) -> str:
    """Return on which machine the packets of a burst were lost: at the sender, between the interfaces, or at the receiver."""
    lost = burst.tried * (1.0 - burst.delivered)
    if burst.unresolved or burst.damaged >= lost / 2:
        return "link"  # nobody answers ARP; or bits were changed on the way
    if burst.changed >= lost / 2:
        # Valid packets with other content: only the rule that overwrites them tells where.
        changing = [
            machine for machine in (burst.sender, burst.receiver) if any(map(overwrites, path.filters.get(machine, ())))
        ]
        return changing[0] if changing else "link"
    if sum(burst.errors.values()) >= lost / 2 or (burst.left is not None and burst.left <= burst.tried - lost / 2):
        return burst.sender
    if burst.reached is not None and burst.reached >= burst.tried - lost / 2:
        return burst.receiver
    return "link"


def overwrites(rule: str) -> bool:
    """Return whether a rule of nft writes other bytes into packets."""
    return bool(re.search(r"@(ll|nh|th),\d+,\d+ set ", rule))


def is_loss(path: Path, direction: str) -> bool:
    """Return whether packets in a direction are lost whatever their port: at random, with their rate, or by damage.

    A filter of ports takes all packets to a port. So it is none if a port receives some of them, or if one that received none
    of a burst receives packets that are sent slowly.
    """
    small, paced = small_burst(path, direction), path.paced(direction)
    if small is None or small.delivered >= PASSES:
        return False
    if small.unresolved or max(small.damaged, small.changed) >= small.tried * (1.0 - small.delivered) / 2:
        return True
    if any(TAKES_SOME.search(rule) for rule in path.filters.get(losing_machine(path, small), ())):
        return True  # other traffic may use up what a limit lets pass
    if paced is not None and paced.arrived:
        silent = small.silent_ports if small.arrived else small.ports
        return not silent or not set(silent) <= set(paced.silent_ports)
    return small.delivered >= LOST and not small.silent_ports


def is_limited(path: Path, direction: str) -> bool:
    """Return whether clearly more of the packets that were sent slowly arrived than of those sent at once."""
    small, paced = small_burst(path, direction), path.paced(direction)
    return small is not None and paced is not None and paced.delivered >= small.delivered + LIMITED
