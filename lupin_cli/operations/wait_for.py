"""`wait-for`: something that comes about by itself - a listener, a unit, the controllers, a machine, a file."""

from __future__ import annotations

import re
from typing import Any, ClassVar

from lupin_cli.operations.base import Difference
from lupin_cli.operations.controller_list import complaints, controller_states
from lupin_cli.operations.shell import look, quote
from lupin_cli.operations.unit import check_unit_name
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target

_LISTENER = re.compile(r"(udp|tcp):(\d{1,5})\Z")
_HOST = re.compile(r"[A-Za-z0-9][A-Za-z0-9.:-]*\Z")


@dataclass(frozen=True, kw_only=True)
class WaitFor:
    """Exactly one of its arguments, as long as the step's `timeout` at most. It changes nothing."""

    name: ClassVar[str] = "wait-for"
    settle_s: ClassVar[float] = float("inf")

    listener: str = ""  # udp:11811
    unit: str = ""  # is active
    controllers: bool = False  # all five are active
    reachable: str = ""  # a host that answers this machine
    path: str = ""  # exists
    machine: str = "robot"

    def __post_init__(self) -> None:
        given = [self.listener, self.unit, self.controllers, self.reachable, self.path]
        if sum(map(bool, given)) != 1:
            raise ValueError("it waits for exactly one of listener, unit, controllers, reachable and path")
        if self.listener and not _LISTENER.match(self.listener):
            raise ValueError(f"a listener is udp:PORT or tcp:PORT, unlike {self.listener!r}")
        if self.unit:
            check_unit_name(self.unit)
        if self.reachable and not _HOST.match(self.reachable):
            raise ValueError(f"{self.reachable!r} is neither an address nor a host's name")

    def _lacking(self, target: Target) -> str:
        """What is not there yet, in words; empty where it is."""
        if self.controllers:
            wrong = complaints(controller_states(target))
            return "; ".join(wrong)
        if self.unit:
            state = look(target, f"systemctl is-active -- {quote(self.unit)}").stdout.strip()
            return "" if state == "active" else f"{self.unit} is {state or 'unknown'}"
        if self.listener:
            protocol, port = self.listener.split(":")
            said = look(target, f"ss -H -ln{protocol[0]} 'sport = :{port}'").stdout.strip()
            return "" if said else f"nobody listens on {protocol} {port}"
        if self.reachable:
            host = quote(self.reachable)
            # A machine without ping asks for SSH, which every robot has.
            ask = f"ping -n -c 1 -W 1 {host} >/dev/null 2>&1 || timeout 2 bash -c ': <>/dev/tcp/'{host}/22 2>/dev/null"
            answered = look(target, ask).ok
            return "" if answered else f"{self.reachable} does not answer"
        return "" if look(target, f"[ -e {quote(self.path)} ]").ok else f"there is no {self.path}"

    def differs(self, target: Target) -> Difference | None:
        lacking = self._lacking(target)
        return Difference(f"waits: {lacking}", "", {}) if lacking else None

    def change(self, target: Target, difference: Difference) -> None:
        """Nothing: the runner asks again until it has come about."""

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        """Nothing."""
