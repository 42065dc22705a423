"""Watches who publishes on a topic that only one node may publish on."""

from __future__ import annotations

from dataclasses import dataclass, field

from rclpy.node import Node

# A node that was killed stays in the graph until its DDS lease of 20 s expires, and its successor has the same name.
SUCCESSION_S = 25.0
# A node's endpoints are discovered before its name. A participant that is not a ROS node never gets a name.
NAMING_S = 3.0
_UNNAMED = "_NODE_NAME_UNKNOWN_"  # rmw's text


@dataclass
class PublisherWatch:
    """Reports publishers of `topic` other than one node called `expected`. `danger` says what they can do."""

    node: Node
    topic: str
    expected: str
    danger: str
    _since_ns: dict[str, int] = field(default_factory=dict, init=False)  # when each kind of intruder was first seen

    def alarms(self, now_ns: int) -> tuple[str, ...]:
        """Return one sentence per intruder.

        A node with another name counts as an intruder at once, one without a name after NAMING_S, and a second node with the
        expected name after SUCCESSION_S.
        """
        names = [endpoint.node_name for endpoint in self.node.get_publishers_info_by_topic(self.topic)]
        found = [f"the node {_printable(name)}" for name in sorted(set(names) - {self.expected, _UNNAMED})]
        if self._lasts(_UNNAMED, _UNNAMED in names, now_ns, NAMING_S):
            found.append("a participant that is no ROS node")
        if self._lasts(self.expected, names.count(self.expected) > 1, now_ns, SUCCESSION_S):
            found.append(f"a second node {self.expected}")
        return tuple(f"{self.topic} is also published by {intruder}, {self.danger}" for intruder in found)

    def _lasts(self, what: str, seen: bool, now_ns: int, timeout_s: float) -> bool:
        if not seen:
            self._since_ns.pop(what, None)
            return False
        return now_ns - self._since_ns.setdefault(what, now_ns) > timeout_s * 1e9


def _printable(name: str) -> str:
    """Make a node's name, which comes from the network, safe for a log line."""
    return "".join(character if character.isprintable() else "?" for character in name)[:80]
