"""`wait-for`: wait until something is there: a listener, a unit, the controllers, a host or a path."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

from lupin_cli.connection.base import Output, Script
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.controller_states import controllers_probe, find_inactive, parse_controllers
from lupin_cli.operations.shell import quote, text_of
from lupin_cli.operations.unit import check_unit_name

_LISTENER = re.compile(r"(udp|tcp):(\d{1,5})\Z")
_HOST = re.compile(r"[A-Za-z0-9][A-Za-z0-9.:-]*\Z")


@dataclass(frozen=True, kw_only=True)
class WaitFor(Operation):
    """Takes exactly one argument and waits for at most the step's `timeout`. Changes nothing."""

    name: ClassVar[str] = "wait-for"
    effect: ClassVar[str] = "a listener, a unit, the controllers, a host or a path is there; changes nothing, only waits"
    settle_s: ClassVar[float] = float("inf")
    only_waits: ClassVar[bool] = True

    listener: str = ""  # udp:11811
    unit: str = ""  # is active
    controllers: bool = False  # all five are active
    reachable: str = ""  # a host that answers this machine
    path: str = ""  # exists

    def __post_init__(self) -> None:
        given = [self.listener, self.unit, self.controllers, self.reachable, self.path]
        if sum(map(bool, given)) != 1:
            raise ValueError("it waits for exactly one of listener, unit, controllers, reachable and path")
        if self.listener and not _LISTENER.match(self.listener):
            raise ValueError(f"a listener is udp:PORT or tcp:PORT, not {self.listener!r}")
        if self.unit:
            check_unit_name(self.unit)
        if self.reachable and not _HOST.match(self.reachable):
            raise ValueError(f"{self.reachable!r} is neither an address nor a host name")

    def probe(self) -> Script:
        if self.controllers:
            return controllers_probe()
        if self.unit:
            return probe_script(f"systemctl is-active -- {quote(self.unit)}")
        if self.listener:
            protocol, port = self.listener.split(":")
            return probe_script(f"ss -H -ln{protocol[0]} 'sport = :{port}'")
        if self.reachable:
            host = quote(self.reachable)
            # A machine without ping tries the SSH port, which every robot has.
            return probe_script(
                f"ping -n -c 1 -W 1 {host} >/dev/null 2>&1 || timeout 2 bash -c ': <>/dev/tcp/'{host}/22 2>/dev/null"
            )
        return probe_script(f"[ -e {quote(self.path)} ]")

    def judge(self, output: Output) -> Difference | None:
        missing = self._missing(output)
        return Difference(f"wait: {missing}") if missing else None

    def _missing(self, output: Output) -> str:
        """Describe in words what is not there yet; empty if it is there."""
        if self.controllers:
            return "; ".join(find_inactive(parse_controllers(output)))
        if self.unit:
            state = output.stdout.strip() or "unknown"
            if len(state.split()) != 1:
                raise OperationError(f"could not read the state of {self.unit}: found {state[:80]!r}")
            return "" if state == "active" else f"{self.unit} is {state}"
        if self.listener:
            protocol, port = self.listener.split(":")
            listens = text_of(output, "the listening sockets").strip()
            return "" if listens else f"nothing listens on {protocol} {port}"
        if self.reachable:
            return "" if output.ok else f"{self.reachable} does not answer"
        return "" if output.ok else f"{self.path} does not exist"
