"""Findings, checks and machines made of words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import pytest

from lupin_cli.checks import Finding, Fix, Severity
from lupin_cli.target import Output, Script


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
