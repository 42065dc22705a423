"""A doctor's session: how often it asks each machine, and when it gathers follow-up facts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from lupin_cli.checks import Check, Finding, Fix, Severity, Snapshot
from lupin_cli.connection import Output
from lupin_cli.connection.inventory import Config, Robot
from lupin_cli.doctor.session import DoctorResult, DoctorScope, DoctorSession, examine_all
from lupin_cli.facts import Fact

if TYPE_CHECKING:
    from tests.lupin_cli.doctor.conftest import ScriptedMachine


def examine(*checks: Check, laptop: ScriptedMachine) -> DoctorResult:
    return DoctorSession(DoctorScope(checks, (), laptop)).examine()  # type: ignore[arg-type]


def finding(evidence: str) -> Finding:
    return Finding("ache", Severity.PROBLEM, "laptop", "s", "c", (evidence,), Fix("rest"))


def test_laptop_is_asked_once_for_many_robots(machine: type[ScriptedMachine], tmp_path: Path) -> None:
    parsed: list[str] = []
    fact = Fact("words", "echo words", lambda output: parsed.append(output.stdout) or output.stdout)  # type: ignore[func-returns-value]
    seen: list[str | None] = []
    check = Check("c", lambda snapshot: seen.append(snapshot.laptop.get(fact)) or (), laptop=(fact,))  # type: ignore[func-returns-value]
    laptop = machine({"words": Output(0, "four")})
    config = Config(tmp_path / "lupin.toml")
    # Nothing listens on port 1 of loopback: each robot is refused at once.
    robots = [Robot(f"pot-{n}", {"wired": f"127.0.0.{n}:1"}) for n in range(1, 6)]
    sessions = [DoctorSession(DoctorScope([check], (), laptop, robot, config)) for robot in robots]  # type: ignore[arg-type]
    links = [result.link for result in examine_all(sessions)]
    assert laptop.asked == [["words"]] and parsed == ["four"]
    assert seen == ["four"] * 5
    assert [link.kind for link in links if link] == ["refused"] * 5
    assert [link.robot for link in links if link] == [robot.name for robot in robots]


def test_second_examination_asks_the_laptop_again(machine: type[ScriptedMachine]) -> None:
    fact = Fact("words", "echo words", lambda output: output.stdout)
    laptop = machine({"words": Output(0, "four")})
    session = DoctorSession(DoctorScope([Check("c", lambda _snapshot: (), laptop=(fact,))], (), laptop))  # type: ignore[arg-type]
    session.examine()
    session.examine()
    assert laptop.asked == [["words"], ["words"]]


def test_followup_facts_are_gathered_only_after_a_finding(machine: type[ScriptedMachine]) -> None:
    symptom = Fact("symptom", "echo", lambda output: output.stdout)
    expensive = Fact("expensive", "sleep 5", lambda output: output.stdout)

    def find(snapshot: Snapshot) -> Iterator[Finding]:
        if snapshot.laptop.get(symptom) == "sick":
            yield finding(snapshot.laptop.get(expensive) or "not asked")

    check = Check("ache", find, laptop=(symptom,), followup_laptop=(expensive,))
    well = machine({"symptom": Output(0, "well"), "expensive": Output(0, "seen")})
    assert examine(check, laptop=well).diagnosis.roots == ()
    assert well.asked == [["symptom"]]
    sick = machine({"symptom": Output(0, "sick"), "expensive": Output(0, "seen")})
    result = examine(check, laptop=sick)
    (root,) = result.diagnosis.roots
    assert root.finding.evidence == ("seen",)
    assert set(result.snapshot.laptop.outputs) == {"symptom", "expensive"}
    assert sick.asked == [["symptom"], ["expensive"]]


def test_followup_facts_can_clear_a_finding(machine: type[ScriptedMachine]) -> None:
    answers = iter(("sick", "well"))
    fact = Fact("symptom", "echo", lambda _output: next(answers))

    def find(snapshot: Snapshot) -> Iterator[Finding]:
        if snapshot.laptop.get(fact) == "sick":
            yield finding("line")

    check = Check("ache", find, laptop=(fact,), followup_laptop=(fact,))
    assert examine(check, laptop=machine({"symptom": Output(0, "")})).diagnosis.roots == ()
