"""Which rule of a packet filter takes packets away, and the command that removes it or lets the packets pass. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from ipaddress import ip_address, ip_network

from lupin_cli.checks.base import Snapshot
from lupin_cli.checks.remote_command import FixText, command_on

SSH_PORT = 22
SHOWN_REMOVALS = 3  # of more rules than these, a person chooses
LIST_RULES = "sudo nft -a list ruleset; sudo iptables-legacy-save || sudo iptables-save"
# Words of rules that take no UDP datagram of DDS: other protocols, and IPv6.
_OTHER_PROTOCOL = re.compile(
    r"\btcp\b|\bicmp|\bsctp\b|(nfproto|protocol) ipv6|\bip6 |-p (tcp|icmp)\b|ct state invalid|ctstate INVALID"
)
_PORT = re.compile(r"(?:dport|dports|sport|sports) (?P<ports>\{[^}]*\}|[\d:,-]+)")
_INTERFACE = re.compile(
    r"(?:[io]ifname |[io]if )(?P<other_than>!= )?(?P<names>\{[^}]*\}|[^\s{!]\S*)|(?P<negated>! )?-[io] (?P<name>\S+)"
)

_ADDRESS = re.compile(
    r"(?P<end>[sd])addr (?P<other_than>!= )?(?P<networks>\{[^}]*\}|[\d./]+(?!\S))"
    r"|(?P<negated>! )?-(?P<option>[sd]) (?P<network>[\d./]+)"
)
_INCOMING, _OUTGOING = ("ingress", "prerouting", "input"), ("output", "postrouting", "egress")


@dataclass(frozen=True)
class FilterRule:
    """A rule as the agent of the path reports it: its place, and its text as nft or iptables prints it."""

    tool: str  # nft, iptables or iptables-legacy
    family: str  # inet, ip, ip6, ...; empty for iptables
    table: str
    chain: str
    hook: str  # input, output, ...; `-` if another chain jumps to it, or if that is not known
    text: str

    @property
    def manager(self) -> str:
        """The program that wrote the rule and would write it again; empty if none is known."""
        if self.table == "firewalld":
            return "firewalld"
        return "ufw" if self.chain.startswith(("ufw-", "ufw6-")) else ""

    @property
    def is_policy(self) -> bool:
        """Whether it is a chain's policy, which takes what no rule accepts."""
        return "policy drop" in self.text or self.text.startswith(":")

    @property
    def place(self) -> tuple[str, str, str]:
        """Its chain."""
        return self.family, self.table, self.chain

    @property
    def stage(self) -> str:
        """The hook at which it sees packets; `-` if that is not known. iptables names its own chains after the hooks."""
        return self.chain.lower() if self.tool != "nft" and self.chain.isupper() else self.hook

    def may_take(
        self, ports: Iterable[int], interface: str, *, incoming: bool, other: str = "", own: Sequence[str] = ()
    ) -> bool:
        """Return whether it may take UDP datagrams to these ports, at this interface, between the `other` end and its `own`.

        `own` are the addresses that this end may have in the packets; empty if they are not known.
        """
        matched = self.text.partition("reject with ")[0]  # what it answers with is another protocol than what it takes
        if self.family in ("ip6", "bridge", "arp") or (_OTHER_PROTOCOL.search(matched) and "udp" not in matched):
            return False
        if self.stage == "forward" or self.stage in (_OUTGOING if incoming else _INCOMING):
            return False
        if other and not _admits(self.text, "s" if incoming else "d", other):
            return False
        if own and not any(_admits(self.text, "d" if incoming else "s", address) for address in own):
            return False
        if interface and not _admits_interface(self.text, interface):
            return False
        named = _PORT.search(self.text)
        return named is None or any(_names_port(named["ports"], port) for port in ports)

    def exception(self, other: str, protocol: str, *, incoming: bool) -> str:
        """Return the command by which its chain accepts packets of a protocol from or to the `other` end, before all rules."""
        if self.tool != "nft":
            ends = f"-{'s' if incoming else 'd'} {other}"
            return f"sudo {self.tool} -t {self.table} -I {self.chain} {ends} -p {protocol} -j ACCEPT"
        ends = f"ip {'s' if incoming else 'd'}addr {other}"
        return f"sudo nft insert rule {self.family} {self.table} {self.chain} {ends} meta l4proto {protocol} accept"

    def removal(self) -> str:
        """Return the command that removes it; empty if that is not known."""
        if self.tool != "nft":
            words = self.text.split()
            return f"sudo {self.tool} -t {self.table} -D {' '.join(words[1:])}" if words[:1] == ["-A"] else ""
        place = f"{self.family} {self.table} {self.chain}"
        handle = re.search(r"# handle (\d+)$", self.text)
        return f"sudo nft delete rule {place} handle {handle[1]}" if handle else ""


def parse_rule(line: str) -> FilterRule | None:
    """Return the rule of a line of `Agent.firewall`; None if it has no place."""
    place, colon, text = line.partition(": ")
    words = place.split()
    if not colon or len(words) not in (2, 5) or words[0] not in ("nft", "iptables", "iptables-legacy"):
        return None
    if words[0] == "nft":
        return FilterRule(words[0], words[1], words[2], words[3], words[4], text)
    chain = text.removeprefix("-A ").removeprefix(":").split()[0] if text.strip() else ""
    return FilterRule(words[0], "", words[1], chain, "-", text)


def _admits(text: str, end: str, address: str) -> bool:
    """Return whether a rule's own condition on the source (`s`) or destination (`d`) fits an address."""
    for found in _ADDRESS.finditer(text):
        if (found["end"] or found["option"]) != end:
            continue
        networks = re.findall(r"[\d.]+(?:/\d+)?(?!\S*-)", found["networks"] or found["network"])
        try:
            contains = any(ip_address(address) in ip_network(network, strict=False) for network in networks)
        except ValueError:
            continue
        if contains == bool(found["other_than"] or found["negated"]):
            return False
    return True


def _admits_interface(text: str, interface: str) -> bool:
    """Return whether a rule's own condition on the interface fits this one."""
    for found in _INTERFACE.finditer(text):
        names = re.findall(r'[^\s",{}]+', found["names"] or found["name"])
        if any(name.startswith("@") for name in names):
            continue  # a named set, whose elements are not known
        # A wildcard is `*` in nft and `+` in iptables.
        fits = any(interface.startswith(name[:-1]) if name.endswith(("*", "+")) else interface == name for name in names)
        if fits == bool(found["other_than"] or found["negated"]):
            return False
    return True


def _names_port(text: str, port: int) -> bool:
    for part in re.findall(r"\d+(?:\s*[-:]\s*\d+)?", text):
        first, last = (int(number) for number in (re.split(r"\s*[-:]\s*", part) * 2)[:2])
        if first <= port <= last:
            return True
    return False


def let_packets_pass(
    snapshot: Snapshot,
    machine: str,
    lines: Sequence[str],
    ports: Sequence[int],
    interface: str,
    other: str,
    *,
    incoming: bool,
    own: Sequence[str] = (),
) -> FixText:
    """Return how a machine's packet filter lets UDP to `ports` pass, from or to the `other` end; `own` as in `may_take`.

    A rule is removed where it is known. A chain whose policy drops is a person's intention: it gets an exception for the other
    end. ufw and firewalld are told to accept the packets that their rules take; that mends nothing while a rule of another
    table takes them, too. Otherwise the rules are listed.
    """
    parsed = [rule for rule in map(parse_rule, lines) if rule is not None]
    rules = [rule for rule in parsed if rule.may_take(ports, interface, incoming=incoming, other=other, own=own)]
    direction = "from" if incoming else "to"
    managers = sorted({rule.manager for rule in rules} - {""})
    others = [rule for rule in rules if not (rule.manager or rule.is_policy) and _aims_at(rule, other)]
    beside = [removal for rule in others[:SHOWN_REMOVALS] if (removal := rule.removal())]
    and_others = f"; the command also removes: {_name_rules(others[:SHOWN_REMOVALS])}" if beside else ""
    if managers == ["ufw"]:
        allow = f"sudo ufw allow {'from' if incoming else 'out to'} {other}"
        return FixText(
            command=command_on(snapshot, machine, " && ".join((allow, *beside))),
            instruction=f"ufw of the {machine} takes the packets{and_others}",
        )
    if managers == ["firewalld"] and incoming:
        trust = f"sudo firewall-cmd --zone=trusted --add-source={other}"
        return FixText(
            command=command_on(snapshot, machine, " && ".join((trust, f"{trust} --permanent", *beside))),
            instruction=f"firewalld of the {machine} takes the packets{and_others}",
        )
    policies = [rule for rule in rules if rule.is_policy]
    if policies:
        protocol = "tcp" if list(ports) == [SSH_PORT] else "udp"
        chains = " and ".join(f"{rule.table} {rule.chain}" for rule in policies)
        # The exception comes before the rules of its own chain and of those that it jumps to, but not of other chains.
        elsewhere = [rule for rule in rules if rule.stage != "-" and rule.place not in {policy.place for policy in policies}]
        commands = [rule.exception(other, protocol, incoming=incoming) for rule in policies]
        commands += [rule.removal() for rule in elsewhere[:SHOWN_REMOVALS] if rule.removal()]
        return FixText(
            command=command_on(snapshot, machine, " && ".join(commands)),
            instruction=f"{chains} of the {machine} drops what no rule accepts. The command accepts {protocol.upper()} "
            f"{direction} {other} until the packet filter is loaded again; add it to the filter's configuration",
        )
    removals = [removal for rule in rules if (removal := rule.removal())]
    if 0 < len(rules) == len(removals) <= SHOWN_REMOVALS:
        return FixText(
            command=command_on(snapshot, machine, " && ".join(removals)),
            instruction=f"the command removes from the packet filter of the {machine}: {_name_rules(rules)}. "
            "What wrote the rule may write it again at the next start",
        )
    shown = "TCP 22" if list(ports) == [SSH_PORT] else f"UDP {', '.join(map(str, ports[:4]))}"
    return FixText(
        command=command_on(snapshot, machine, LIST_RULES),
        instruction=f"remove the rule of the {machine} that takes {shown} {direction} {other}; the command lists all rules",
    )


def _aims_at(rule: FilterRule, other: str) -> bool:
    """Return whether a rule names ports or the `other` end, so that it is about these packets and not about all."""
    return bool(_PORT.search(rule.text)) or other in rule.text.split()


def _name_rules(rules: Iterable[FilterRule]) -> str:
    return "; ".join(re.sub(r" # handle \d+$", "", rule.text) for rule in rules)
