"""A doctor's session: how often it asks each machine, and when it gathers follow-up facts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from lupin_cli.checks import Check, Finding, Fix, Severity, Snapshot, ground_truth, stale_resources
from lupin_cli.checks import path as path_checks
from lupin_cli.checks.ground_truth import State
from lupin_cli.checks.stale_resources import MEMORY_AT_RISK
from lupin_cli.connection import Output
from lupin_cli.connection.base import Unreachable
from lupin_cli.connection.inventory import Config, Robot
from lupin_cli.doctor.engine import diagnose
from lupin_cli.doctor.fixes import FixResult
from lupin_cli.doctor.session import DoctorResult, DoctorScope, DoctorSession, examine_all
from lupin_cli.facts import Fact, Facts
from lupin_cli.facts.clock import Offset
from lupin_cli.facts.graph import Graph, Graphs
from lupin_cli.facts.link import Link
from lupin_cli.link.path import End
from lupin_cli.link.path import Path as MeasuredPath
from lupin_cli.link.quality import Ping
from tests.lupin_cli.checks.test_ground_truth import received
from tests.support.optional import present
from tests.support.snapshots import HEALTHY_ROBOT, captured, values

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


def test_fix_is_healed_only_if_its_finding_was_looked_for(machine: type[ScriptedMachine]) -> None:
    sick, fact = iter((True, False)), Fact("symptom", "echo", lambda output: output.stdout)
    check = Check("ports", lambda _: [finding("line")] if next(sick) else (), laptop=(fact,))

    def session(laptop: ScriptedMachine) -> DoctorSession:
        return DoctorSession(DoctorScope([check], (), laptop))  # type: ignore[arg-type]

    answering = session(machine({"symptom": Output(0, "x")}))
    played = FixResult("port-8090-taken", "sweep", "done", changed=1, where="laptop")
    still = answering.examine()
    assert answering.judge_fix(replace(played, finding="ache"), still).state == "done"
    gone = answering.examine()
    assert answering.judge_fix(played, gone).state == "healed"
    assert answering.judge_fix(replace(played, state="failed"), gone).state == "failed"
    assert answering.judge_fix(replace(played, dry_run=True), gone).state == "done"
    check = Check("ports", lambda _: (), laptop=(fact,))
    silent = session(machine({"symptom": Output(None, "")}))
    unseen = silent.judge_fix(played, silent.examine())
    assert unseen.state == "done" and "could not be examined" in unseen.message


@pytest.mark.parametrize(("kind", "measured"), [("timeout", 1), ("silent", 1), ("lost", 1), ("refused", 0), ("name", 0)])
def test_path_of_a_robot_that_does_not_answer_is_measured(
    machine: type[ScriptedMachine], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, measured: int
) -> None:
    asked: list[tuple[object, str, object]] = []

    def measure(_laptop: object, robot: object, address: str, _on_layer: object, sshd: object) -> MeasuredPath:
        asked.append((robot, address, sshd))
        ping = Ping(12, 3, (160.0,) * 3)
        return MeasuredPath(address, End("laptop", "eth0", "192.0.2.1"), ping=ping, unmeasured="no SSH")

    def fail(_session: DoctorSession) -> None:
        raise Unreachable("no answer", kind)

    monkeypatch.setattr("lupin_cli.link.path_measurement.measure_from", measure)
    monkeypatch.setattr("lupin_cli.link.quality.echo_burst", lambda _: None)
    monkeypatch.setattr(DoctorSession, "_connect", fail)
    monkeypatch.delenv("ROS_DISCOVERY_SERVER", raising=False)
    # The laptop's facts are there at once: what arrives does not tell that the link is bad.
    robot = Robot("pot", {"wired": "192.0.2.2:2022"})
    session = DoctorSession(DoctorScope(path_checks.CHECKS, (), machine({}), robot, Config(tmp_path / "lupin.toml")))  # type: ignore[arg-type]
    roots = [root.finding.id for root in session.examine().diagnosis.roots]
    sshd = ("192.0.2.2", 2022) if kind == "timeout" else None
    assert asked == [(None, "192.0.2.2", sshd)] * measured
    assert roots == ["packets-lost"] * measured


@pytest.mark.parametrize(
    ("visit_s", "burst", "measured"),
    [(2.1, None, 0), (5.4, None, 1), (2.1, 40, 0), (2.1, 36, 0), (2.1, 20, 1), (2.1, 0, 0)],
)
def test_path_is_measured_after_a_late_visit_or_a_lost_burst(
    machine: type[ScriptedMachine],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    visit_s: float,
    burst: int | None,
    measured: int,
) -> None:
    asked: list[str] = []

    def measure(_laptop: object, _robot: object, address: str, *_: object) -> MeasuredPath:
        asked.append(address)
        return MeasuredPath(address, End("laptop", "eth0", "192.0.2.1"))

    def echo_burst(address: str) -> Ping | None:
        assert address == "192.0.2.2"
        return None if burst is None else Ping(40, burst, (1.0,) * burst)

    graphs = Graphs((received(visit_s=visit_s),))
    monkeypatch.setattr("lupin_cli.link.quality.echo_burst", echo_burst)
    link = Link("pot", "192.0.2.2", transport="wired", clock=Offset(0.0, 0.001))
    monkeypatch.setattr("lupin_cli.link.path_measurement.measure_from", measure)
    monkeypatch.setattr(
        "lupin_cli.doctor.session.gather_snapshot",
        lambda *_: Snapshot(Facts("laptop", {"graph": graphs}), Facts("robot", {}), link),
    )
    monkeypatch.delenv("ROS_DISCOVERY_SERVER", raising=False)
    robot = Robot("pot", {"wired": "192.0.2.2"})
    session = DoctorSession(DoctorScope(path_checks.CHECKS, (), machine({}), robot, Config(tmp_path / "lupin.toml")))  # type: ignore[arg-type]
    session.examine()
    assert asked == ["192.0.2.2"] * measured


@pytest.mark.parametrize(("second", "severity"), [("silent", Severity.PROBLEM), ("as before", Severity.WARNING)])
def test_data_of_a_stopped_process_is_looked_for_twice(
    machine: type[ScriptedMachine], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, second: str, severity: Severity
) -> None:
    group = "/system.slice/mirte-ros.service"
    processes = tuple(replace(each, state="T", group=group) for each in values(HEALTHY_ROBOT)["ros-processes"][1:2])
    facts = Facts("robot", {"ros-processes": processes})
    heard = Graphs((received(),))
    again = heard if second == "as before" else Graphs((Graph("robot", "robot", ()),))
    link = Link("pot", "192.0.2.2", transport="wired", clock=Offset(0.0, 0.001))
    monkeypatch.setattr(
        "lupin_cli.doctor.session.gather_snapshot", lambda *_: Snapshot(Facts("laptop", {"graph": heard}), facts, link)
    )
    monkeypatch.setattr("lupin_cli.doctor.session.gather_facts", lambda *_: Facts("laptop", {"graph": again}))
    robot = Robot("pot", {"wired": "192.0.2.2"})
    checks = (*ground_truth.CHECKS, *(check for check in stale_resources.CHECKS if check.name == "processes.stopped"))
    session = DoctorSession(DoctorScope(checks, (), machine({}), robot, Config(tmp_path / "lupin.toml")))  # type: ignore[arg-type]
    diagnosis = session.examine().diagnosis
    assert [(root.finding.id, root.finding.severity) for root in diagnosis.roots] == [("process-stopped", severity)]
    assert present(diagnosis.ground_truth).state is (State.BROKEN if second == "silent" else State.UNOBSERVED)


@pytest.mark.parametrize(
    ("addresses", "chosen", "expected"),
    [
        ({"wired": "127.0.0.1:1", "ap": "127.0.0.2:1"}, "", ("127.0.0.1", "wired")),
        ({"wired": "127.0.0.1:1", "ap": "127.0.0.2:1"}, "ap", ("127.0.0.2", "ap")),
        ({"": "127.0.0.1:1"}, "", ("127.0.0.1", "")),
    ],
)
def test_link_to_unreachable_robot_has_its_transport(
    machine: type[ScriptedMachine], tmp_path: Path, addresses: dict[str, str], chosen: str, expected: tuple[str, str]
) -> None:
    robot = Robot("pot", addresses, transport=chosen)
    scope = DoctorScope((), (), machine({}), robot, Config(tmp_path / "lupin.toml"))  # type: ignore[arg-type]
    link = present(DoctorSession(scope).examine().link)
    assert not link.reachable and (link.address, link.transport) == expected
    assert link.addresses == {transport: host.partition(":")[0] for transport, host in addresses.items()}


@pytest.mark.parametrize("selected", [True, False], ids=["check selected", "check skipped"])
@pytest.mark.parametrize(("account", "endangered"), [("loses-memory", True), ("in-all-groups", False)])
def test_memory_that_this_login_endangers_is_found(
    monkeypatch: pytest.MonkeyPatch, machine: type[ScriptedMachine], account: str, endangered: bool, selected: bool
) -> None:
    """Also if its check was not selected: the login was made all the same."""
    stack_user = replace(captured("account", account), uid=0)  # the stack was captured as it ran as root
    facts = Facts("robot", values({**HEALTHY_ROBOT, "account": stack_user}))
    snapshot = Snapshot(Facts("laptop", {}), facts, Link("pot", "10.42.0.1", login="ssh mirte@10.42.0.1"))
    checks = (MEMORY_AT_RISK,) if selected else ()
    result = DoctorResult(snapshot, diagnose(checks, snapshot))
    monkeypatch.setattr(DoctorSession, "get_reachable_robot", lambda *_: machine({}))
    monkeypatch.setattr("lupin_cli.doctor.session.gather_facts", lambda *_: facts)
    found = DoctorSession(DoctorScope(checks, (), machine({}))).find_endangered_memory(result)  # type: ignore[arg-type]
    assert (found is not None) == endangered
    assert found is None or found.fix.command == "lupin play keep-shared-memory --robot pot"
