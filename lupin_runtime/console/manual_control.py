"""Velocities and stops of the clients. They are published from the event loop: they must not wait behind other requests."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Callable, Collection, Hashable
from contextlib import suppress
from typing import Any, Protocol

from geometry_msgs.msg import Twist
from std_msgs.msg import String

from lupin_runtime import graph
from lupin_runtime.console import values
from lupin_runtime.console.authority import Authority, Refused, Session
from lupin_runtime.console.command_era import CommandEra
from lupin_runtime.console.estop_reasons import OF_CONSOLES, EstopReasons
from lupin_runtime.console.run_history import RunHistory
from lupin_runtime.console.stop_registry import StopRegistry
from lupin_runtime.ros import LupinNode

STOP_PERIOD_S = 0.5
_ESTOP_DELAY_NS = 1_500_000_000  # after which the e-stop's status contains a release of the clients' stop


class Driver(Hashable, Protocol):
    """A client that may drive and stop the robot."""

    session: Session


class ManualControl:
    """Drives and stops the robot for all clients. Methods are called on the event loop."""

    def __init__(
        self,
        node: LupinNode,
        authority: Authority,
        estop: EstopReasons,
        era: CommandEra,
        record: Callable[..., None],
        history: RunHistory,
        now: values.Now,
    ) -> None:
        """`record` has the signature of CommandJournal.record. `history` gets every change of a stop, once it was published."""
        self._node = node
        self._authority = authority
        self._estop = estop
        self._era = era
        self._record = record
        self._history = history
        self._now = now
        self._stops = StopRegistry()
        self._server = f"{socket.gethostname()} {os.getpid()} {time.time_ns()}"
        self._presses = self._releases = 0
        self._was_stopped = False
        self._stopped_ns = -_ESTOP_DELAY_NS  # when a client last held the stop
        self._stop_output = node.publisher(graph.CONSOLE_STOP)
        self._manual_output = node.publisher(graph.CMD_VEL_MANUAL)
        authority.on_change(self._follow_control)

    def join(self, client: Driver) -> None:
        """Add a client."""
        self._stops.join(client, client.session.name, self._node.monotonic_ns())

    def leave(self, client: Driver) -> None:
        """Remove a client. If it was driving, zero velocity is sent."""
        now_ns = self._node.monotonic_ns()
        if self._stops.leave(client, now_ns, self._authority.holds(client.session, now_ns)):
            self._send_zero()
        self.publish_combined_stop()

    def drive(self, client: Driver, twist: dict[str, dict[str, float]]) -> None:
        """Publish a client's velocity: the parts and axes of a Twist, in m/s and rad/s."""
        moving = any(value for axes in twist.values() for value in axes.values())
        is_start = self._stops.note_velocity(client, moving, self._node.monotonic_ns())
        if is_start:
            self.publish_combined_stop()
        self._manual_output.publish(values.fill(Twist, twist, self._now))
        if is_start:
            self._record(client.session.name, "drive")

    def is_driven_by_others(self, client: Driver) -> bool:
        """Return whether a client other than this one is driving."""
        return self._stops.is_driving(self._node.monotonic_ns(), except_for=client)

    def set_stop(self, client: Driver, engaged: bool, press: str = "") -> str:
        """Engage a client's own stop, or let go of it, which everybody may. A page names its `press`.

        A program names none: with control, which it takes if it is free, it also releases the stops of closed connections.
        Returns who has released this press meanwhile, so that it is not engaged again; otherwise an empty text.
        """
        now_ns = self._node.monotonic_ns()
        held = self._stops.holds(client)
        if held and not engaged and not press:
            with suppress(Refused):
                self._authority.take(client.session, now_ns)
                self._releases += 1
                self._stops.release_lost(client.session.name)
        overruled_by = self._stops.set_stop(client, engaged, now_ns, press)
        holds = self._stops.holds(client)
        if holds != held:
            self.publish_combined_stop()
        self._authority.note_alive(client.session, now_ns)
        return overruled_by

    def stop_for(self, session: Session, press: str = "") -> None:
        """Engage a stop for a session that has no connection to hold it; the session in control releases it."""
        self._stops.hold_for(session.name, self._node.monotonic_ns(), press)
        self.publish_combined_stop()

    def release_for(self, session: Session, presses: Collection[str] | None = None) -> None:
        """Release the stops of these presses, whoever holds them: not a newer one, which the session has not seen yet.

        Without `presses`, release those that no client holds any more. Both also release the stop of a console that is gone.
        Raises Refused without control, which is taken if it is free.
        """
        self._authority.take(session, self._node.monotonic_ns())
        self._record(session.name, "release")
        self._releases += 1
        if presses is None:
            self._stops.release_lost(session.name)
        else:
            self._stops.release(presses, session.name)
        self.publish_combined_stop()

    def withdraw_for(self, session: Session, press: str) -> None:
        """Let go of a press that the session engaged itself, with or without control; nothing happens if it is over."""
        if self._stops.withdraw(press, session.name):
            self._record(session.name, "let go of its stop")
            self.publish_combined_stop()

    def stops(self) -> list[dict[str, Any]]:
        """Return what engages the stop, for browsers: the clients' stops, then what else holds the robot.

        Each has the `kind` of its cause, a `text`, and its `press`, `name` and age, which are None for a reason of the e-stop.
        """
        now_ns = self._node.monotonic_ns()
        own = self._stops.reasons()
        others = self._estop.reasons
        if own or now_ns - self._stopped_ns < _ESTOP_DELAY_NS:
            others = tuple(reason for reason in others if reason not in OF_CONSOLES)
        return [
            *(
                {
                    "kind": hold.kind.value,
                    "text": hold.text,
                    "press": hold.press,
                    "name": hold.name,
                    "age_s": max(0, now_ns - hold.since_ns) // 1_000_000_000,
                }
                for hold in own
            ),
            *({"kind": "robot", "text": reason, "press": None, "name": None, "age_s": None} for reason in others),
        ]

    def _follow_control(self) -> None:
        """Stop the wheels when control has changed, before the next session begins to drive."""
        now_ns = self._node.monotonic_ns()
        if self._stops.end_driving(now_ns):
            self._send_zero()
        self._era.note_holder(self._authority.lease(now_ns).holder)

    def _send_zero(self) -> None:
        self._manual_output.publish(Twist())

    def publish_combined_stop(self) -> None:
        """Publish the combined stop of all clients. To be called every STOP_PERIOD_S."""
        now_ns = self._node.monotonic_ns()
        lease = self._authority.lease(now_ns)
        self._stops.check_silence(now_ns, lease.holder, lease.since_ns)
        engaged = bool(self._stops.reasons())
        if engaged or self._was_stopped:
            self._stopped_ns = now_ns
        self._era.note_stop(engaged)
        self._presses += engaged and not self._was_stopped
        self._was_stopped = engaged
        statement = {
            "server": self._server,
            "engaged": engaged,
            "driving": self._stops.is_driving(now_ns),
            "presses": self._presses,
            "releases": self._releases,
        }
        self._stop_output.publish(String(data=json.dumps(statement)))
        for event in self._stops.take_events():
            self._history.note(event)
