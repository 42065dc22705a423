"""A fact, and the facts of one machine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any, Generic, TypeVar

from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

Value = TypeVar("Value")


@dataclass(frozen=True)
class Fact(Generic[Value]):
    """A question that both ends are asked.

    `probe` is POSIX sh that needs no more than a base Debian and changes nothing. `parse` is pure: it turns the probe's output
    into a frozen value, and raises ValueError with what it could not read. `at_once` says that it reads what the kernel has at
    hand: nothing keeps such a probe waiting, so it shares a shell of the user's with others.
    """

    name: str
    probe: str
    parse: Callable[[Output], Value]
    timeout_s: float = 12.0  # a bound: a robot at load 8 to 12, as it is normal for one, answers in seconds
    root: bool = False
    at_once: bool = False


@dataclass(frozen=True)
class Unknown:
    """In a value's place where the machine could not be asked, did not answer in time, or answered what nobody can read."""

    reason: str


@dataclass(frozen=True)
class Facts:
    """The facts of one machine, by name."""

    machine: str  # "robot" or "laptop"
    values: Mapping[str, Any]
    asked_ns: tuple[int, int] | None = None  # this machine's wall clock before the question left and after the answer came
    outputs: Mapping[str, Output] = field(default_factory=dict, repr=False)  # what the probes printed, by the fact's name

    def get(self, fact: Fact[Value]) -> Value | None:
        """The value, or None where it is unknown."""
        value = self.values.get(fact.name)
        return None if isinstance(value, Unknown) else value

    def why_unknown(self, fact: Fact[Any]) -> str:
        """Why `fact` has no value here; empty where it has one."""
        value = self.values.get(fact.name, Unknown("was not asked"))
        return value.reason if isinstance(value, Unknown) else ""
