"""Faults that take, delay, change or limit packets, at either end or on the link."""

from __future__ import annotations

import random
from dataclasses import dataclass

from bench.faults.fault import (
    ENDS,
    ROBOT,
    SECOND_INTERFACES,
    SERVER_PORT,
    Effect,
    Fault,
    filter_step,
    harmless,
    interface_match,
    link_fault,
    table_name,
)


@dataclass(frozen=True)
class _Traffic:
    """Packets that a rule can match, as nft words. In `match`, %s stands for `dport` or `sport`, depending on the direction."""

    text: str
    match: str
    layer: str
    effect: Effect
    hides_robot: bool = False


_USER_DATA = ", ".join(str(port) for port in range(7411, 7480, 2))
_TRAFFIC = (
    _Traffic(f"UDP of port {SERVER_PORT}", f"udp %s {SERVER_PORT}", "ports", Effect.BREAKS),
    _Traffic("all UDP", "meta l4proto udp", "ports", Effect.BREAKS),
    _Traffic("UDP to the participants' ports", "udp dport 7400-7600", "ports", Effect.BREAKS),
    _Traffic("UDP to the participants' odd ports", f"udp dport {{ {_USER_DATA} }}", "ports", Effect.MAY_BREAK),
    _Traffic("UDP datagrams above 400 bytes", "udp length > 400", "mtu", Effect.MAY_BREAK),
    _Traffic("TCP 22", "tcp %s 22", "login", Effect.BREAKS, hides_robot=True),
)


def drop_packets(rng: random.Random) -> Fault:
    """All packets of a kind that the operator needs, at either end and in either direction."""
    machine, hook, traffic = rng.choice(ENDS), rng.choice(("input", "output")), rng.choice(_TRAFFIC)
    to_robot = (machine == ROBOT) == (hook == "input")
    match = traffic.match.replace("%s", "dport" if to_robot else "sport")
    interface = rng.choice(("", interface_match(machine, hook) + " "))
    verdict = rng.choice(("drop", "drop", "reject")) if hook == "input" else "drop"
    step = filter_step(machine, hook, table_name(rng), f"{interface}{match} counter {verdict}")
    text = f"{machine}: {hook} of {traffic.text}: {verdict}"
    return Fault("drop", text, "cable", traffic.layer, machine, traffic.effect, (step,), hides_robot=traffic.hides_robot)


def deny_incoming(rng: random.Random) -> Fault:
    """What a desktop's firewall does: only answers come in."""
    machine = rng.choice(ENDS)
    rule = f"{interface_match(machine, 'input')} ct state new meta l4proto udp counter drop"
    step = filter_step(machine, "input", table_name(rng), rule)
    return Fault("drop", f"{machine}: unsolicited UDP: drop", "cable", "ports", machine, Effect.MAY_BREAK, (step,))


def drop_fraction(rng: random.Random) -> Fault:
    """A fraction of all packets, at either end."""
    machine, hook, percent = rng.choice(ENDS), rng.choice(("input", "output")), rng.choice((20, 30, 45, 60, 80))
    rule = f"{interface_match(machine, hook)} meta l4proto udp numgen random mod 100 < {percent} counter drop"
    effect = Effect.BREAKS if percent >= 60 else Effect.MAY_BREAK
    text = f"{machine}: {hook} of {percent} % of UDP: drop"
    step = filter_step(machine, hook, table_name(rng), rule)
    return Fault("drop", text, "cable", "loss", machine, effect, (step,), also_layer="ports")


def drop_on_link(rng: random.Random) -> Fault:
    """Packets between both ends: at random, or to some ports."""
    if rng.random() < 0.5:
        loss = rng.choice((0.1, 0.2, 0.35, 0.5, 0.7))
        effect = Effect.BREAKS if loss >= 0.5 else Effect.MAY_BREAK
        return link_fault("drop", f"lossy-link loss={loss}", "loss", effect, hides_robot=loss >= 0.35)
    direction = rng.choice(("to-robot", "from-robot"))
    first, last = rng.choice(((7400, 7600), (1024, 65535)))
    words = f"filtered-link direction={direction} first_port={first} last_port={last}"
    if direction == "to-robot" and rng.random() < 0.4:
        words = f"filtered-link direction=to-robot first_port={SERVER_PORT} last_port={SERVER_PORT}"
    return link_fault("drop", words, "ports", Effect.BREAKS)


def drop_unused(rng: random.Random) -> Fault:
    """Packets that no operator needs."""
    machine, hook = rng.choice(ENDS), rng.choice(("input", "output"))
    port = rng.choice((rng.randrange(1024, 7000), rng.randrange(20000, 32000)))
    match = rng.choice(
        (
            *(f"tcp dport {port}", f"udp dport {port}", "meta nfproto ipv6", "ip protocol sctp"),
            "icmp type echo-request ip length < 100",
            f"{interface_match(machine, hook, SECOND_INTERFACES)} tcp dport {port}",
        )
    )
    step = filter_step(machine, hook, table_name(rng), f"{match} counter drop")
    return harmless("drop", f"{machine}: {hook} of {match}: drop", step)


def delay_packets(rng: random.Random) -> Fault:
    """Latency of the link, far above what a cable has."""
    delay_ms = rng.choice((80, 150, 300, 700, 1500))
    effect = Effect.BREAKS if delay_ms >= 1500 else Effect.MAY_BREAK
    words = f"slow-link delay_ms={delay_ms}.0 jitter_ms={delay_ms * rng.choice((0.0, 0.2))}"
    return link_fault("delay", words, "loss", effect, hides_robot=delay_ms >= 700)  # a login takes twenty round trips


def reorder_packets(rng: random.Random) -> Fault:
    """Jitter above the distance of packets."""
    jitter_ms = rng.choice((2.0, 5.0, 15.0))
    return link_fault("reorder", f"slow-link delay_ms={jitter_ms} jitter_ms={jitter_ms}", "loss", Effect.MAY_BREAK)


def duplicate_packets(rng: random.Random) -> Fault:
    """A link that delivers frames twice; DDS and TCP discard the copies."""
    words = f"duplicating-link fraction={rng.choice((0.1, 0.3, 1.0))}"
    return link_fault("duplicate", words, "loss", Effect.MAY_BREAK)


def corrupt_packets(rng: random.Random) -> Fault:
    """Bits that flip on the link, or bytes that a rule at one end overwrites."""
    if rng.random() < 0.5:
        fraction = rng.choice((0.1, 0.3, 0.6))
        return link_fault(
            "corrupt", f"corrupting-link fraction={fraction}", "loss", Effect.MAY_BREAK, hides_robot=fraction >= 0.3
        )
    machine, percent = rng.choice(ENDS), rng.choice((30, 60, 100))
    hook = rng.choice(("input", "output"))
    share = f"numgen random mod 100 < {percent} " if percent < 100 else ""  # nft takes no comparison that always holds
    # The first word behind the UDP header is the protocol's name, RTPS: a receiver ignores a datagram without it.
    rule = f"{interface_match(machine, hook)} meta l4proto udp {share}counter @th,64,32 set 0xdeadbeef"
    effect = Effect.BREAKS if percent >= 60 else Effect.MAY_BREAK
    text = f"{machine}: {hook} of {percent} % of UDP: payload overwritten"
    step = filter_step(machine, hook, table_name(rng), rule)
    return Fault("corrupt", text, "cable", "loss", machine, effect, (step,), also_layer="ports")


def limit_bandwidth(rng: random.Random) -> Fault:
    """Few packets a second: the rest is dropped at one end."""
    machine, rate, hook = rng.choice(ENDS), rng.choice((10, 30, 100)), rng.choice(("input", "output"))
    rule = f"{interface_match(machine, hook)} meta l4proto udp limit rate over {rate}/second counter drop"
    text = f"{machine}: {hook} of UDP above {rate} packets a second: drop"
    step = filter_step(machine, hook, table_name(rng), rule)
    return Fault("limit", text, "cable", "loss", machine, Effect.MAY_BREAK, (step,))
