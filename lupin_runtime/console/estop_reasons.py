"""The reasons that the e-stop's status gives for a stop, such as its button."""

from __future__ import annotations

from typing import Any

from lupin_runtime import graph
from lupin_runtime.json_text import parse_json
from lupin_runtime.ros import LupinNode
from lupin_runtime.safety.console_server_stop import BROWSER_HOLDS_STOP, LOST, UNHEARD

# What the e-stop says about the stops that consoles state, of which this one knows its own better and earlier.
OF_CONSOLES = (BROWSER_HOLDS_STOP, LOST, UNHEARD)


class EstopReasons:
    """Follows the e-stop's status. `update` is called on the executor's thread; the attributes may be read on any."""

    def __init__(self, node: LupinNode) -> None:
        self.reasons: tuple[str, ...] = ()
        self.changes = 0  # how often the e-stop was engaged or released
        self._node = node
        node.subscription(graph.ESTOP_STATUS, self._receive)

    def update(self) -> None:
        """Forget the status of an e-stop that is gone. To be called about twice a second."""
        if self.reasons and not self._node.count_publishers(graph.ESTOP_STATUS.name):
            self.reasons = ()

    def _receive(self, message: Any) -> None:
        reasons = read_reasons(message.data)
        self.changes += bool(reasons) != bool(self.reasons)
        self.reasons = reasons


def read_reasons(text: str) -> tuple[str, ...]:
    """Return the reasons in an e-stop's status; empty if it is released, or malformed."""
    try:
        status = parse_json(text)
        engaged, reasons = status["engaged"], status["reasons"]
    except (ValueError, KeyError, TypeError):
        return ()
    return tuple(str(reason) for reason in reasons) if engaged is True and isinstance(reasons, list) else ()
