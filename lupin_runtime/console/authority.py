"""Who may do what: roles, the allow-lists from the graph's table, and the operator lease.

Everybody may watch and stop the robot. One session at a time holds the operator lease, which messages call "control"; only that
session may move anything or release the stop.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

from lupin_runtime import graph
from lupin_runtime.console.console_events import ConsoleEvent, EventKind
from lupin_runtime.ros.type_names import absolute

LEASE_TIMEOUT_S = 5.0  # a holder that has been silent for this long loses the operator lease
REQUEST_TIMEOUT_S = 10.0  # a request for control that the holder has not answered after this time counts as refused
_CANCEL = "/_action/cancel_goal"
READ_ONLY_PREFIX = "/rosapi/"
_WRITES = ("/rosapi/set_param", "/rosapi/delete_param")


# Reasons of refusals.
HELD_BY_OTHER = "{name} has had control for {seconds:.0f} s; ask for it or take it over"
IS_VIEWER = "{name} is a viewer; to drive, pair this browser as operator"
OTHER_ASKS = "{name} is already asking for control; ask again later"
HAS_NO_CONTROL = "{name} does not have control"
NOBODY_ASKS = "nobody is asking for control now"
NOT_ALLOWED = "{what} is not allowed to clients of the console"


class Role(enum.Enum):
    """What a session may do: a viewer may watch and stop the robot, an operator may also take control."""

    VIEWER = "viewer"
    OPERATOR = "operator"


class Refused(PermissionError):
    """A request that the session may not make; the text gives the reason, and what to do if anything helps."""


@dataclass(frozen=True)
class Session:
    """A paired browser, or one program that is connected to rosbridge."""

    name: str
    role: Role


@dataclass(frozen=True)
class LeaseState:
    """Who has control, and who is asking for it, each with the time since when; None stands for nobody."""

    holder: str | None
    since_ns: int
    requester: str | None = None
    requested_ns: int = 0


class Authority:
    """Decides which requests are allowed, and who holds the operator lease. Times are monotonic nanoseconds.

    `log_change` is called with every change of the lease, after the listeners. With `allow_unlisted`, for development and
    tests, everybody may also use topics, services and actions that the graph's table does not contain.
    """

    def __init__(self, log_change: Callable[[ConsoleEvent], None], *, allow_unlisted: bool = False) -> None:
        self._log_change = log_change
        self._allow_unlisted = allow_unlisted
        self._topics = {row.name: row.console for row in graph.topics()}
        self._services = {row.name: row.console for row in graph.services()}
        self._actions = {absolute(row.name): row.console for row in graph.actions()}
        self._holder: Session | None = None
        self._since_ns = self._last_alive_ns = 0
        self._requester: Session | None = None
        self._requested_ns = 0
        self._listeners: list[Callable[[], None]] = []

    # -- the operator lease -------------------------------------------------------------------------------------------
    def lease(self, now_ns: int) -> LeaseState:
        """Return who holds the lease and who is asking for it."""
        self._expire(now_ns)
        holder, requester = self._holder, self._requester
        return LeaseState(
            holder.name if holder else None, self._since_ns, requester.name if requester else None, self._requested_ns
        )

    def on_change(self, listener: Callable[[], None]) -> None:
        """Call `listener` whenever the lease's holder or requester changes."""
        self._listeners.append(listener)

    def holds(self, session: Session, now_ns: int) -> bool:
        """Return whether a session holds the lease."""
        self._expire(now_ns)
        return self._holder is session

    def take(self, session: Session, now_ns: int, *, take_over: bool = False) -> None:
        """Give the lease to an operator if it is free, or with `take_over` also if somebody holds it. Raises Refused.

        For the holder, this counts as a sign of life.
        """
        self._expire(now_ns)
        self._check_role(session)
        if not take_over:
            self.check_take(session, now_ns)
        if self._holder is session:
            self._last_alive_ns = now_ns
            return
        if self._holder is None:
            self._grant(session, now_ns, ConsoleEvent(EventKind.CONTROL_TAKEN, session.name))
        else:
            self._grant(session, now_ns, ConsoleEvent(EventKind.CONTROL_TAKEN_OVER, session.name, self._holder.name))

    def check_take(self, session: Session, now_ns: int) -> None:
        """Check that a session has control or could take it, without taking it. Raises Refused."""
        self._expire(now_ns)
        self._check_role(session)
        if self._holder not in (None, session):
            since_s = (now_ns - self._since_ns) / 1e9
            name = self._holder.name if self._holder else ""
            raise Refused(HELD_BY_OTHER.format(name=name, seconds=since_s))

    def _check_role(self, session: Session) -> None:
        if session.role is not Role.OPERATOR:
            raise Refused(IS_VIEWER.format(name=session.name))

    def request(self, session: Session, now_ns: int) -> bool:
        """Take the lease if it is free, or else ask its holder for it. Raises Refused.

        Returns True if the session holds the lease now, False if the holder has been asked.
        """
        self._expire(now_ns)
        if self._holder is None or self._holder is session:
            self.take(session, now_ns)
            return True
        self._check_role(session)
        if self._requester not in (None, session):
            raise Refused(OTHER_ASKS.format(name=self._requester.name if self._requester else ""))
        if self._requester is None:
            self._requester, self._requested_ns = session, now_ns
            self._notify(ConsoleEvent(EventKind.CONTROL_REQUESTED, session.name, self._holder.name))
        return False

    def answer(self, session: Session, grant: bool, now_ns: int) -> None:
        """Grant or refuse the pending request, on behalf of the holder.

        Raises Refused if the session does not hold the lease, or if no request is pending.
        """
        self._expire(now_ns)
        if self._holder is not session:
            raise Refused(HAS_NO_CONTROL.format(name=session.name))
        requester = self._requester
        if requester is None:
            raise Refused(NOBODY_ASKS)
        if grant:
            self._grant(requester, now_ns, ConsoleEvent(EventKind.CONTROL_PASSED, session.name, requester.name))
        else:
            self._requester = None
            self._notify(ConsoleEvent(EventKind.CONTROL_KEPT, session.name, requester.name))

    def give_up(self, session: Session, now_ns: int, *, left: bool = False) -> None:
        """Withdraw a session's own request, and end its lease if it holds it; the requester, if any, gets the lease.

        `left`: not by its own wish, but because its last connection was closed.
        """
        if self._requester is session:
            self._requester = None
            self._notify(ConsoleEvent(EventKind.CONTROL_REQUEST_WITHDRAWN, session.name))
        if self._holder is not session:
            return
        if self._requester is not None:
            requester = self._requester
            self._grant(requester, now_ns, ConsoleEvent(EventKind.CONTROL_INHERITED, requester.name, session.name))
        else:
            self._holder = None
            self._notify(ConsoleEvent(EventKind.CONTROL_LEFT if left else EventKind.CONTROL_GIVEN_UP, session.name))

    def note_alive(self, session: Session, now_ns: int) -> None:
        """Note a sign of life of a session, which keeps the lease if it holds it."""
        if self._holder is session:
            self._last_alive_ns = now_ns

    def _grant(self, session: Session, now_ns: int, event: ConsoleEvent) -> None:
        self._holder, self._since_ns, self._last_alive_ns = session, now_ns, now_ns
        self._requester = None
        self._notify(event)

    def _expire(self, now_ns: int) -> None:
        if self._holder is not None and now_ns - self._last_alive_ns > LEASE_TIMEOUT_S * 1e9:
            event = ConsoleEvent(EventKind.CONTROL_EXPIRED, self._holder.name, self._requester.name if self._requester else "")
            self._holder = self._requester = None
            self._notify(event)
        if self._requester is not None and now_ns - self._requested_ns > REQUEST_TIMEOUT_S * 1e9:
            event = ConsoleEvent(EventKind.CONTROL_UNANSWERED, self._requester.name, self._holder.name if self._holder else "")
            self._requester = None
            self._notify(event)

    def _notify(self, event: ConsoleEvent) -> None:
        for listener in self._listeners:
            listener()  # one of them stops the wheels, which must not wait for a disk
        self._log_change(event)

    # -- requests -----------------------------------------------------------------------------------------------------
    def check_publish(self, session: Session, topic: str, now_ns: int) -> None:
        """Check that a session may publish on a topic, and take the lease for it if that is needed. Raises Refused."""
        self._authorize(session, self._topics, topic, f"publishing on {topic}", now_ns)

    def check_advertise(self, topic: str) -> None:
        """Check that clients may publish on a topic at all. Takes no lease: advertising moves nothing. Raises Refused."""
        self._rule(self._topics, topic, f"publishing on {topic}")

    def check_call(self, session: Session, service: str, now_ns: int) -> None:
        """Check that a session may call a service, and take the lease for it if that is needed. Raises Refused."""
        service = absolute(service)
        if service.endswith(_CANCEL):
            return  # canceling a goal stops a motion, and everybody may stop
        if service.startswith(READ_ONLY_PREFIX) and service not in _WRITES:
            return
        self._authorize(session, self._services, service, f"calling {service}", now_ns)

    def check_send_goal(self, session: Session, action: str, now_ns: int) -> None:
        """Check that a session may send a goal, and take the lease for it if that is needed. Raises Refused."""
        self._authorize(session, self._actions, absolute(action), f"sending goals to {action}", now_ns)

    def check_provide(self, name: str) -> None:
        """Check that clients may offer a service or action of this name.

        Only with `allow_unlisted` may they offer any, and never one that the graph's table contains. Raises Refused.
        """
        if not self._allow_unlisted or absolute(name) in self._services or absolute(name) in self._actions:
            raise Refused(NOT_ALLOWED.format(what=f"offering {name}"))

    def needs_control(self, name: str) -> bool:
        """Return whether only the session in control may use the topic, service or action of this name."""
        return any(rules.get(absolute(name)) == graph.BY_OPERATOR for rules in (self._topics, self._services, self._actions))

    def _authorize(self, session: Session, rules: dict[str, str], name: str, what: str, now_ns: int) -> None:
        if self._rule(rules, name, what) == graph.BY_OPERATOR:
            self.take(session, now_ns)

    def _rule(self, rules: dict[str, str], name: str, what: str) -> str:
        # Names that the table lacks are refused too: the vendor's motors, for example, have services that it does not list.
        rule = rules.get(absolute(name), graph.BY_VIEWER if self._allow_unlisted else graph.BY_NOBODY)
        if rule == graph.BY_NOBODY:
            raise Refused(NOT_ALLOWED.format(what=what))
        return rule
