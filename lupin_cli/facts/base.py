"""Fact (a probe with its parser), Facts (the values of one machine) and Unknown (a value that is missing)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from lupin_cli.connection.base import Output

Value = TypeVar("Value")


@dataclass(frozen=True)
class Fact(Generic[Value]):
    """A probe and the parser of its output. The same fact can be gathered from robot and laptop.

    `probe` is a POSIX sh script that changes nothing and needs only a base Debian. `parse` is a pure function from the probe's
    output to a frozen value; it raises ValueError for output that it cannot read. Set `runs_in_shared_shell` for a probe that
    only reads what the kernel has in memory: such probes never block, so one shell (of the user, not of root) runs them all.
    """

    name: str
    probe: str
    parse: Callable[[Output], Value]
    timeout_s: float = 12.0  # a robot's load is often 8 to 12, and its probes then take seconds
    root: bool = False
    runs_in_shared_shell: bool = False


@dataclass(frozen=True)
class Unknown:
    """Stands for a value that is missing: its probe could not be run, timed out, or printed something unreadable."""

    reason: str


@dataclass(frozen=True)
class Facts:
    """The facts of one machine, by name."""

    machine: str  # "robot" or "laptop"
    values: Mapping[str, Any]
    probed_ns: tuple[int, int] | None = None  # the laptop's wall clock before the batch was sent and after its output arrived
    outputs: Mapping[str, Output] = field(default_factory=dict, repr=False)  # raw output of each probe, by the fact's name

    def get(self, fact: Fact[Value]) -> Value | None:
        """Return the value of `fact`, or None if it is unknown."""
        value = self.values.get(fact.name)
        return None if isinstance(value, Unknown) else value

    def why_unknown(self, fact: Fact[Any]) -> str:
        """Return why `fact` has no value; empty if it has one."""
        value = self.values.get(fact.name, Unknown("was not probed"))
        return value.reason if isinstance(value, Unknown) else ""
