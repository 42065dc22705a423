"""Packets that are lost by their size or at random, or that come late."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Finding, Severity, Snapshot
from lupin_cli.checks.burst_losses import (
    LATE_MS,
    MOSTLY_LOST,
    PASSES,
    TAKES_SOME,
    TO,
    is_limited,
    is_loss,
    losing_machine,
    overwrites,
    shaped_end,
    small_burst,
)
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.layers import EVERYTHING
from lupin_cli.checks.path_ends import ABOVE
from lupin_cli.checks.path_fixes import (
    let_burst_pass,
    try_another_transport,
)
from lupin_cli.checks.remote_command import FixText, command_on, show_transports
from lupin_cli.facts.addresses import is_tunnel
from lupin_cli.link.path import (
    DDS_BYTES,
    DOWN,
    FRAGMENTED_BYTES,
    LARGE_PING_BYTES,
    TOO_LONG,
    UP,
    Burst,
    Path,
)
from lupin_cli.link.quality import Ping

OFTEN_LOST = 0.2  # of one way: what was heard may not be heard again
BY_CHANCE = "by chance"  # what a finding is about, if so much is lost that all data arrived by chance
OVER_SSH_MS = 1000.0  # that late, no robot that is only busy answers
ETHERNET_MTU = 1500
TWICE = 1.15  # frames that come in for each that left; others go the same way
BURST_LOSS, MOST_OF_BURST = 0.15, 0.4  # of 40 pings at once: more than a wireless link loses at random, and most one way
_LIMITS_RATE = "slowly sent ones pass: something limits their rate"


def find_lost_large(snapshot: Snapshot, path: Path, direction: str, random_loss: float) -> Iterator[Finding]:
    """Yield a finding if packets of a size are lost more often than chance explains, which takes `random_loss` of all."""
    for size in (DDS_BYTES, FRAGMENTED_BYTES):
        # A fragmented packet is lost with any of its fragments.
        expected = (1.0 - random_loss) ** (1 if size == DDS_BYTES else 1 + FRAGMENTED_BYTES // DDS_BYTES)
        lost = [burst for burst in path.of(direction, size) if burst.delivered < 0.4 * expected]
        if not lost or expected < 0.5:
            continue
        if size == FRAGMENTED_BYTES and arrives_twice(lost[0]):
            yield _unjoined(snapshot, lost[0])
            return
        ends = [end for end in (path.laptop, path.robot) if end is not None]
        by_tunnel = any(is_tunnel(end.interface) for end in ends)
        fragments_pass = size == DDS_BYTES and any(
            burst.delivered >= 0.4 * expected for burst in path.of(direction, FRAGMENTED_BYTES)
        )
        # DDS lets its sender fragment what is larger than the MTU of an interface, which these packets forbid.
        if size == DDS_BYTES and (lost[0].errors.get(TOO_LONG, 0) >= lost[0].tried / 2 or (by_tunnel and fragments_pass)):
            continue
        small = next((end for end in ends if 0 < end.mtu < ETHERNET_MTU and not is_tunnel(end.interface)), None)
        why = f": {small.interface} of the {small.machine} has an MTU of {small.mtu}" if small is not None else ""
        yield make_finding(
            "large-packets-lost",
            where=small.machine if small is not None else losing_machine(path, lost[0]),
            # A smaller MTU in between: senders learn it, unless something takes the ICMP away that tells it.
            severity=Severity.WARNING if fragments_pass else Severity.PROBLEM,
            cause=f"packets of {size} bytes {TO[direction]} are lost, small ones pass{why}",
            evidence=(lost[0].line(), *(end.line() for end in ends)),
            command=command_on(snapshot, small.machine, f"sudo ip link set {small.interface} mtu {ETHERNET_MTU}")
            if small is not None
            else show_transports(snapshot),
            explains={ground_truth.UNEXPLAINED} if fragments_pass else ABOVE,
            breaks=() if fragments_pass else (EVERYTHING,),
            about=direction,
        )
        return


def arrives_twice(burst: Burst) -> bool:
    """Return whether more frames came in at the receiver than had left the sender."""
    return bool(burst.left) and (burst.reached or 0) > TWICE * (burst.left or 0)


def _unjoined(snapshot: Snapshot, burst: Burst) -> Finding:
    """Return the finding that fragments arrive twice: what is left of each packet takes memory that others need."""
    return make_finding(
        "packets-lost",
        where="link",
        cause=f"frames {TO[burst.direction]} arrive twice, and packets of {burst.size} bytes are lost at the {burst.receiver}: "
        "what is left of their fragments fills the memory in which its kernel joins them",
        evidence=(burst.line(),),
        explains={ground_truth.UNEXPLAINED},
        breaks=(),
        **try_another_transport(snapshot),
    )


def find_lost_large_pings(snapshot: Snapshot, path: Path) -> Iterator[Finding]:
    """Yield a finding if large packets get no answer where small ones do: SSH opens its connection, and hears nothing on it."""
    small, large = path.ping, path.large_ping
    if small is None or large is None or large.received or small.loss > 1.0 - MOSTLY_LOST:
        return
    own_mtu = path.laptop.mtu
    is_own = 0 < own_mtu < ETHERNET_MTU and not is_tunnel(path.laptop.interface)
    why = f": {path.laptop.interface} of the laptop has an MTU of {own_mtu}" if is_own else ""
    yield make_finding(
        "large-packets-lost",
        where="laptop" if is_own else "link",
        cause=f"packets of {LARGE_PING_BYTES} bytes get no answer, small ones do{why}",
        evidence=(
            f"ping {path.address}: {small.received} of {small.sent} answered",
            f"ping -s {LARGE_PING_BYTES} {path.address}: {large.received} of {large.sent} answered",
            path.laptop.line(),
        ),
        command=command_on(snapshot, "laptop", f"sudo ip link set {path.laptop.interface} mtu {ETHERNET_MTU}")
        if is_own
        else show_transports(snapshot),
        explains=ABOVE,
        breaks=(EVERYTHING,),
    )


def loses_bursts(at_once: Ping | None) -> bool:
    """Return whether pings that were sent at once were lost; without any answer, ping is filtered, or the robot is off."""
    return at_once is not None and at_once.received > 0 and at_once.loss > BURST_LOSS


def find_loss_and_delay(snapshot: Snapshot, path: Path, broken: bool) -> Iterator[Finding]:
    """Yield a finding if packets are lost at random, or come late; it is a warning while everything arrives nevertheless."""
    small = {direction: burst for direction in (UP, DOWN) if (burst := small_burst(path, direction))}
    lossy = {direction: burst for direction, burst in small.items() if is_loss(path, direction)}
    losses = {TO[direction]: 1.0 - burst.delivered for direction, burst in lossy.items()}
    ping = path.ping
    if not small and ping is not None and 0 < ping.received < ping.sent - 1:
        losses = {"there and back": ping.loss}
    at_once = path.burst_ping if not losses and loses_bursts(path.burst_ping) else None
    if at_once is not None:
        losses = {"that are sent at once there and back": at_once.loss}
    rtt_ms = _round_trip_ms(snapshot, path)
    if not losses and rtt_ms < LATE_MS:
        return
    parts = [f"{loss:.0%} of the packets {direction} are lost" for direction, loss in losses.items()]
    paced = [burst for direction in lossy if (burst := path.paced(direction))]
    if any(is_limited(path, burst.direction) and burst.delivered > PASSES for burst in paced):
        parts.append(_LIMITS_RATE)
    parts += [_LIMITS_RATE] if at_once is not None else []
    parts += [f"a round trip takes {rtt_ms:.0f} ms"] if rtt_ms >= LATE_MS else []
    evidence = [burst.line() for burst in (*small.values(), *paced)]
    if rtt_ms >= OVER_SSH_MS:
        evidence.append(f"the clock was asked over SSH: the answer took {rtt_ms:.0f} ms")
    if ping is not None:
        rtts = ", ".join(f"{rtt:.0f}" for rtt in ping.rtts_ms)
        evidence.append(f"ping {path.address}: {ping.received} of {ping.sent} answered, after {rtts or '-'} ms")
    shaped = shaped_end(path)
    if shaped is not None:
        parts.append(f"a queueing discipline of {shaped.interface} of the {shaped.machine} does it")
        evidence += [f"tc qdisc show dev {shaped.interface}: {line}" for line in shaped.shaping]
    worst = min(lossy.values(), key=lambda burst: burst.delivered, default=None)
    where = shaped.machine if shaped is not None else losing_machine(path, worst) if losses and worst is not None else "link"
    by_rule = any(TAKES_SOME.search(rule) or overwrites(rule) for rule in path.filters.get(where, ()))
    fix = try_another_transport(snapshot)
    if shaped is not None:
        fix = FixText(command=command_on(snapshot, shaped.machine, f"sudo tc qdisc del dev {shaped.interface} root"))
    elif worst is not None and by_rule:
        fix = let_burst_pass(snapshot, path, where, worst, worst.ports)
    # Programs that join meet each other with a burst of packets: they fail at times while those of this visit did not.
    # A ping must pass twice.
    one_way = [1.0 - burst.delivered for burst in lossy.values()] or [1.0 - (1.0 - loss) ** 0.5 for loss in losses.values()]
    most_lost = max(one_way, default=0.0) > MOSTLY_LOST or (at_once is not None and at_once.loss > MOST_OF_BURST)
    is_luck = max(one_way, default=0.0) > OFTEN_LOST
    hinders = broken or most_lost or (snapshot.link is not None and not snapshot.link.reachable)
    yield make_finding(
        "packets-lost",
        where=where,
        severity=Severity.PROBLEM if hinders else Severity.WARNING,
        cause="; ".join(parts),
        evidence=evidence,
        explains=ABOVE if broken else {"robot-unreachable"},
        breaks=None if broken else (),
        about=BY_CHANCE if is_luck else "",
        **fix,
    )


def _round_trip_ms(snapshot: Snapshot, path: Path) -> float:
    """Return how long a round trip takes: as ping measured it, or as SSH did where ping does not wait long enough."""
    if path.ping is not None and path.ping.rtts_ms:
        return sorted(path.ping.rtts_ms)[len(path.ping.rtts_ms) // 2]
    clock = snapshot.link.clock if snapshot.link is not None else None
    over_ssh_ms = 2e3 * clock.bound_s if clock is not None else 0.0
    return over_ssh_ms if over_ssh_ms >= OVER_SSH_MS else 0.0
