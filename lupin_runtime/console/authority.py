"""Who may do what: roles, the allow-lists of the graph's table, and the lease of the one session that drives.

Everybody may look and stop. Only a session that holds the lease moves anything or releases the stop.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

from lupin_runtime import graph
from lupin_runtime.console.interfaces import absolute

LEASE_SILENCE_S = 5.0  # after this silence of its holder, the lease is free for others
REQUEST_S = 10.0  # the holder answers a request for the lease within this time, or it is refused
_CANCEL = "/_action/cancel_goal"
READ_ONLY_PREFIX = "/rosapi/"
_WRITES = ("/rosapi/set_param", "/rosapi/delete_param")


class Role(enum.Enum):
    """What a session may ask for: a viewer looks and stops, an operator may take the lease."""

    VIEWER = "viewer"
    OPERATOR = "operator"


class Refused(PermissionError):
    """A request that the session may not make; the text is the reason and what to do."""


@dataclass(frozen=True)
class Session:
    """A paired browser or a local client."""

    name: str
    role: Role


@dataclass(frozen=True)
class LeaseState:
    """Who drives, and since when; who asks for it, and since when. None where nobody does."""

    holder: str | None
    since_ns: int
    requester: str | None = None
    requested_ns: int = 0


class Authority:
    """Decides over requests. `journal` gets a line for every change of the lease. Times are monotonic nanoseconds.

    `unlisted` also opens to everybody what the graph's table does not have, for development and tests.
    """

    def __init__(self, journal: Callable[[str], None], *, unlisted: bool = False) -> None:
        self._journal = journal
        self._unlisted = unlisted
        self._topics = {row.name: row.console for row in graph.topics()}
        self._services = {row.name: row.console for row in graph.services()}
        self._actions = {absolute(row.name): row.console for row in graph.actions()}
        self._holder: Session | None = None
        self._since_ns = self._seen_ns = 0
        self._requester: Session | None = None
        self._requested_ns = 0
        self._listeners: list[Callable[[], None]] = []

    # -- the lease ----------------------------------------------------------------------------------------------------
    def lease(self, now_ns: int) -> LeaseState:
        """Who holds the lease."""
        self._expire(now_ns)
        holder, requester = self._holder, self._requester
        return LeaseState(
            holder.name if holder else None, self._since_ns, requester.name if requester else None, self._requested_ns
        )

    def on_change(self, listener: Callable[[], None]) -> None:
        """Call `listener` after every change of the lease's holder or requester."""
        self._listeners.append(listener)

    def holds(self, session: Session, now_ns: int) -> bool:
        """Whether a session holds the lease."""
        self._expire(now_ns)
        return self._holder is session

    def take(self, session: Session, now_ns: int, *, from_holder: bool = False) -> None:
        """Give the lease to an operator where it is free; `from_holder` also takes it from its holder. Raises Refused."""
        self._expire(now_ns)
        if session.role is not Role.OPERATOR:
            raise Refused(f"{session.name} is a viewer; pair this browser as operator to drive")
        if self._holder is session:
            self._seen_ns = now_ns
            return
        if self._holder is not None and not from_holder:
            since_s = (now_ns - self._since_ns) / 1e9
            raise Refused(f"{self._holder.name} has had control for {since_s:.0f} s; ask for it or take it over")
        before = f", taken from {self._holder.name}" if self._holder is not None else ""
        self._give(session, now_ns, f"{session.name} has control{before}")

    def request(self, session: Session, now_ns: int) -> bool:
        """Ask the holder for the lease; returns whether it was free, and is now this session's. Raises Refused."""
        self._expire(now_ns)
        if self._holder is None or self._holder is session:
            self.take(session, now_ns)
            return True
        if session.role is not Role.OPERATOR:
            raise Refused(f"{session.name} is a viewer; pair this browser as operator to drive")
        if self._requester not in (None, session):
            raise Refused(f"{self._requester.name if self._requester else ''} asks for control already")
        if self._requester is None:
            self._requester, self._requested_ns = session, now_ns
            self._changed(f"{session.name} asks {self._holder.name} for control")
        return False

    def answer(self, session: Session, grant: bool, now_ns: int) -> None:
        """The holder's answer to a request. Raises Refused from anybody else, and where nobody asks (any more)."""
        self._expire(now_ns)
        if self._holder is not session:
            raise Refused(f"{session.name} does not have control")
        requester = self._requester
        if requester is None:
            raise Refused("nobody asks for control (any more)")
        if grant:
            self._give(requester, now_ns, f"{session.name} handed control to {requester.name}")
        else:
            self._requester = None
            self._changed(f"{session.name} kept control")

    def give_up(self, session: Session, now_ns: int) -> None:
        """End a session's lease, if it has it; one that asks for it gets it."""
        if self._requester is session:
            self._requester = None
        if self._holder is not session:
            return
        if self._requester is not None:
            self._give(self._requester, now_ns, f"{session.name} left control to {self._requester.name}")
        else:
            self._holder = None
            self._changed(f"{session.name} gave up control")

    def seen(self, session: Session, now_ns: int) -> None:
        """Note that a session is alive."""
        if self._holder is session:
            self._seen_ns = now_ns

    def _give(self, session: Session, now_ns: int, line: str) -> None:
        self._holder, self._since_ns, self._seen_ns = session, now_ns, now_ns
        self._requester = None
        self._changed(line)

    def _expire(self, now_ns: int) -> None:
        if self._holder is not None and now_ns - self._seen_ns > LEASE_SILENCE_S * 1e9:
            line = f"{self._holder.name} lost control after {LEASE_SILENCE_S:g} s of silence"
            self._holder = self._requester = None
            self._changed(line)
        if self._requester is not None and now_ns - self._requested_ns > REQUEST_S * 1e9:
            line = f"{self._requester.name} got no answer within {REQUEST_S:g} s"
            self._requester = None
            self._changed(line)

    def _changed(self, line: str) -> None:
        self._journal(line)
        for listener in self._listeners:
            listener()

    # -- requests -----------------------------------------------------------------------------------------------------
    def publish(self, session: Session, topic: str, now_ns: int) -> None:
        """Check that a session may publish on a topic; takes the lease where it is free. Raises Refused."""
        self._check(session, self._topics, topic, f"publishing on {topic}", now_ns)

    def advertise(self, topic: str) -> None:
        """Check that clients may publish on a topic at all; announcing moves nothing, so it needs no lease. Raises Refused."""
        self._rule(self._topics, topic, f"publishing on {topic}")

    def call(self, session: Session, service: str, now_ns: int) -> None:
        """Check that a session may call a service. Raises Refused."""
        service = absolute(service)
        if service.endswith(_CANCEL):
            return  # to cancel a goal is to stop
        if service.startswith(READ_ONLY_PREFIX) and service not in _WRITES:
            return
        self._check(session, self._services, service, f"calling {service}", now_ns)

    def send_goal(self, session: Session, action: str, now_ns: int) -> None:
        """Check that a session may send a goal. Raises Refused."""
        self._check(session, self._actions, absolute(action), f"sending goals to {action}", now_ns)

    def provide(self, name: str) -> None:
        """Check that clients may offer a service or an action of this name: none that the graph already has. Raises Refused."""
        if not self._unlisted or absolute(name) in self._services or absolute(name) in self._actions:
            raise Refused(f"offering {name} is not allowed to clients of the console")

    def _check(self, session: Session, rules: dict[str, str], name: str, what: str, now_ns: int) -> None:
        if self._rule(rules, name, what) == graph.BY_OPERATOR:
            self.take(session, now_ns)

    def _rule(self, rules: dict[str, str], name: str, what: str) -> str:
        # A name that the table lacks may belong to the vendor's motors.
        rule = rules.get(absolute(name), graph.BY_VIEWER if self._unlisted else graph.BY_NOBODY)
        if rule == graph.BY_NOBODY:
            raise Refused(f"{what} is not allowed to clients of the console")
        return rule
