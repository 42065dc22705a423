"""`laptop-clock`: whether the robot's clock may be set from this machine's. Changes nothing."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.connection.local import LocalTarget
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.base import Fact
from lupin_cli.facts.chrony import CHRONY
from lupin_cli.facts.kernel_clock import KERNEL_CLOCK
from lupin_cli.link.clock_offset import estimate
from lupin_cli.link.laptop_clock import ClockEvidence, doubt_laptop, remedy_command
from lupin_cli.operations.base import Difference, Operation, probe_script
from lupin_cli.operations.clock_samples import parse_samples, take_samples

_LAPTOP_FACTS = (CHRONY, KERNEL_CLOCK, ADDRESSES)
_PART = "=== "  # begins the line before each part of the completed output
_SAMPLES, _ROBOT = "samples", "robot"
Value = TypeVar("Value")


@dataclass(frozen=True, kw_only=True)
class LaptopClock(Operation):
    """Reports the `doubt` with both times, empty if there is none, and the `remedy`, a command for this machine.

    If only a person can tell which clock is wrong, the remedy is `override`: what sets the robot's clock all the same.
    """

    name: ClassVar[str] = "laptop-clock"
    effect: ClassVar[str] = "read only: why the robot's clock must not be set from the laptop's, which may be the wrong one"
    read_only: ClassVar[bool] = True
    report_keys: ClassVar[tuple[str, ...]] = ("doubt", "remedy")

    override: str = ""

    def probe(self) -> Script:
        return probe_script(CHRONY.probe, timeout_s=CHRONY.timeout_s)

    def complete(self, target: Target, output: Output) -> Output:
        scripts = [Script(fact.name, fact.probe, fact.timeout_s) for fact in _LAPTOP_FACTS]
        own = LocalTarget().batch(scripts, max(fact.timeout_s for fact in _LAPTOP_FACTS))
        parts = {name: each.stdout for name, each in own.items()}
        parts |= {_ROBOT: output.stdout, _SAMPLES: take_samples(target).stdout}
        return Output(0, "".join(f"{_PART}{name}\n{text}\n" for name, text in parts.items()))

    def judge(self, output: Output) -> Difference | None:
        return None

    def report(self, output: Output) -> dict[str, Any]:
        parts = _split(output.stdout)
        samples = parse_samples(Output(0, parts.get(_SAMPLES, "")))
        offset, own_ns = estimate(samples).offset, samples[-1].received_ns
        laptop = _parse(CHRONY, parts.get(CHRONY.name, ""))
        doubt = doubt_laptop(
            ClockEvidence(
                offset,
                laptop,
                _parse(KERNEL_CLOCK, parts.get(KERNEL_CLOCK.name, "")),
                _parse(ADDRESSES, parts.get(ADDRESSES.name, "")),
                _parse(CHRONY, parts.get(_ROBOT, "")),
            )
        )
        if doubt is None:
            return {"doubt": "", "remedy": ""}
        times = f"the robot's clock shows {_date(own_ns * 1e-9 + offset.offset_s)}, this machine's {_date(own_ns * 1e-9)}"
        if doubt.is_certain:
            return {"doubt": f"{times}: {doubt.reason}", "remedy": remedy_command(laptop)}
        only_if = "type the next command only if this machine's time is right"
        return {"doubt": f"{times}: {doubt.reason}; {only_if}", "remedy": self.override}


def _split(text: str) -> dict[str, str]:
    parts: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in text.splitlines():
        if line.startswith(_PART):
            lines = parts.setdefault(line.removeprefix(_PART), [])
        else:
            lines.append(line)
    return {name: "\n".join(lines) for name, lines in parts.items()}


def _parse(fact: Fact[Value], text: str) -> Value | None:
    with suppress(ValueError):
        return fact.parse(Output(0, text))
    return None


def _date(epoch_s: float) -> str:
    try:
        return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(epoch_s))
    except (OSError, OverflowError, ValueError):  # a year that no calendar has
        return f"{epoch_s:.0f} s after 1970"
