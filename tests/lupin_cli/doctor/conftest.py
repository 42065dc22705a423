"""Scripted machines, findings, and the laptop beside a booted robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from lupin_cli.checks import Finding, Fix, Severity
from lupin_cli.checks.discovery import STARTING_S
from lupin_cli.connection import Output, Script
from lupin_sim.host import Host
from lupin_sim.host.checkout import keep_shared_memory
from lupin_sim.host.fixtures import wait_for_discovery_server
from tests.support.laptop import Laptop, vendor_age_s
from tests.support.waiting import wait_until


@dataclass
class ScriptedMachine:
    """A target with given answers that records which scripts it was asked to run."""

    answers: Mapping[str, Output]
    name: str = "robot"
    user: str = "mirte"
    asked: list[list[str]] = field(default_factory=list)

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:  # noqa: ARG002 -- Target's signature
        self.asked.append([script.name for script in scripts])
        return {script.name: self.answers[script.name] for script in scripts if script.name in self.answers}


@pytest.fixture
def machine() -> type[ScriptedMachine]:
    return ScriptedMachine


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
            fix=Fix(f"fix {id}", **fix),  # type: ignore[arg-type]
            explains=frozenset(explains),
        )

    return make


@pytest.fixture
def laptop(request: pytest.FixtureRequest, tmp_path: Path) -> Laptop:
    host: Host = request.getfixturevalue("fresh_host" if "fresh_host" in request.fixturenames else "host")
    wait_for_discovery_server(host.robot)
    wait_until(lambda: vendor_age_s(host) > STARTING_S, "a vendor stack that is past its start", 30.0)
    keep_shared_memory(host.robot)
    found = Laptop(host, tmp_path / "home")
    found.configure()
    return found
