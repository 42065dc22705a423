"""What else holds the robot: the e-stop's own reasons, such as its button."""

from __future__ import annotations

import json
from typing import Any

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.safety.console_server_stop import HOLDS, LOST, UNHEARD

# What the e-stop says about the stops that consoles state, of which this one knows its own better and earlier.
OF_CONSOLES = (HOLDS, LOST, UNHEARD)


class EstopReasons:
    """Follows the e-stop's status. `update` is called on the executor's thread; `reasons` may be read on any."""

    def __init__(self, node: LupinNode) -> None:
        self.reasons: tuple[str, ...] = ()
        self._node = node
        node.subscription(graph.ESTOP_STATUS, self._receive)

    def update(self) -> None:
        """Forget the status of an e-stop that is gone. To be called about twice a second."""
        if self.reasons and not self._node.count_publishers(graph.ESTOP_STATUS.name):
            self.reasons = ()

    def _receive(self, message: Any) -> None:
        self.reasons = read_reasons(message.data)


def read_reasons(text: str) -> tuple[str, ...]:
    """Return the reasons in an e-stop's status; empty if it is released, or malformed."""
    try:
        status = json.loads(text)
        engaged, reasons = status["engaged"], status["reasons"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return ()
    return tuple(str(reason) for reason in reasons) if engaged is True and isinstance(reasons, list) else ()
