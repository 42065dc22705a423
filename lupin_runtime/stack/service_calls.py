"""The service calls of a visit of the graph: only services without side effects, none of which is waited for."""

from __future__ import annotations

import time
from typing import Any

from lupin_runtime import graph

# A server that has not yet discovered the client when it responds drops the response: the request is repeated meanwhile.
CALL_TIMEOUT_S, REPEAT_CALL_S = 3.0, 0.8
# Three servers in three processes of the robot: the controller manager, the motor board and the onboard stack.
PROBED_SERVICES: tuple[graph.Service, ...] = (
    graph.LIST_CONTROLLERS,
    graph.servo_range(graph.SERVOS[-1]),
    graph.ARM_LIBRARY_LIST,
)


class ServiceCalls:
    """Calls each probed service once. `outcomes` has by its name whether it answered, and after how many seconds.

    `controllers` is what the controller manager answered; None if it has not.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self.outcomes: dict[str, dict[str, Any]] = {}
        self.controllers: list[dict[str, str]] | None = None
        self._pending: dict[str, Any] = {}
        self._since_s: dict[str, float] = {}  # when each call was begun or sent

    @property
    def is_complete(self) -> bool:
        """Whether every probed service has been called."""
        return len(self.outcomes) == len(PROBED_SERVICES)

    @property
    def is_any_answered(self) -> bool:
        """Whether a service has answered."""
        return any(call["answered"] for call in self.outcomes.values())

    def begin(self) -> None:
        """Call every probed service that has a server, without waiting for the responses."""
        from lupin_runtime.ros.interfaces import interface

        served = dict(self._node.get_service_names_and_types())
        for row in PROBED_SERVICES:
            if row.name not in served or row.name in self.outcomes:
                continue
            self.outcomes[row.name] = {"answered": False, "round_trip_s": None}
            self._since_s[row.name] = time.monotonic()
            client = self._node.client(row)
            self._pending[row.name] = (client, interface(row.type).Request(), [])

    def advance(self) -> None:
        """Send the requests whose server is ready, repeat those without a response, and take the responses that arrived."""
        for name, (client, request, sent) in list(self._pending.items()):
            now_s = time.monotonic()
            answered = next(((future, sent_s) for future, sent_s in sent if future.done()), None)
            if answered is not None:
                future, sent_s = answered
                self.outcomes[name] = {"answered": True, "round_trip_s": round(now_s - sent_s, 4)}
                if name == graph.LIST_CONTROLLERS.name:
                    self.controllers = [{"name": c.name, "state": c.state, "type": c.type} for c in future.result().controller]
                del self._pending[name]
            elif not sent and client.service_is_ready():
                self._since_s[name] = now_s
                sent.append((client.call_async(request), now_s))
            elif sent and now_s - sent[-1][1] > REPEAT_CALL_S:
                sent.append((client.call_async(request), now_s))

    def waited_for(self) -> list[tuple[float, float]]:
        """Return (start of the wait, timeout in seconds) of every call without a response."""
        return [(self._since_s[name], CALL_TIMEOUT_S) for name, call in self.outcomes.items() if not call["answered"]]

    def drop_late(self, end_s: float) -> list[str]:
        """Drop the calls that were begun too late to be answered, and return their names; note which others were sent."""
        late = [name for name, call in self.outcomes.items() if not call["answered"]]
        late = [name for name in late if end_s - self._since_s[name] < CALL_TIMEOUT_S]
        for name in late:
            del self.outcomes[name]
        for name, (_, _, sent) in self._pending.items():
            if name in self.outcomes:
                self.outcomes[name]["sent"] = bool(sent)
        return late
