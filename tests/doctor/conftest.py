"""Findings, checks and machines made of words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from lupin_cli.checks import Finding, Fix, Severity
from lupin_cli.checks.discovery import STARTING_S
from lupin_cli.target import Output, Script
from lupin_sim.host import Host
from lupin_sim.host.checkout import keep_memory
from lupin_sim.host.fixtures import until, until_it_serves

from .laptop import Laptop, vendor_age_s


@dataclass
class SpokenMachine:
    """A target that says what a test wrote down, and remembers what it was asked."""

    answers: Mapping[str, Output]
    name: str = "robot"
    user: str = "mirte"
    asked: list[list[str]] = field(default_factory=list)

    def batch(self, scripts: Sequence[Script], bound_s: float = 10.0) -> dict[str, Output]:
        self.asked.append([script.name for script in scripts])
        return {script.name: self.answers[script.name] for script in scripts if script.name in self.answers}


@pytest.fixture
def machine() -> type[SpokenMachine]:
    return SpokenMachine


@pytest.fixture
def finding() -> Callable[..., Finding]:
    def make(id: str, *explains: str, severity: Severity = Severity.PROBLEM, where: str = "robot", **fix: object) -> Finding:
        return Finding(
            id=id,
            severity=severity,
            where=where,
            symptom=f"symptom of {id}",
            cause=f"cause of {id}",
            evidence=(f"line of {id}",),
            fix=Fix(f"mend {id}", **fix),  # type: ignore[arg-type]
            explains=frozenset(explains),
        )

    return make


@pytest.fixture
def laptop(request: pytest.FixtureRequest, tmp_path: Path) -> Laptop:
    host: Host = request.getfixturevalue("fresh_host" if "fresh_host" in request.fixturenames else "host")
    until_it_serves(host.robot)
    until(lambda: vendor_age_s(host) > STARTING_S, "a stack that has been up for a while", 30.0)
    keep_memory(host.robot)
    found = Laptop(host, tmp_path / "home")
    found.set_up()
    return found
