"""Several robots at once."""

from __future__ import annotations

from lupin_cli.checks import Check, Finding, Fix, Severity
from lupin_cli.config import Config, Robot
from lupin_cli.examination import Examination, examine_all
from lupin_cli.facts import Fact
from lupin_cli.target import Output


def test_this_machine_is_asked_once_however_many_robots_there_are(machine, tmp_path) -> None:
    read: list[str] = []
    fact = Fact("words", "echo words", lambda output: read.append(output.stdout) or output.stdout)
    seen: list[str | None] = []
    check = Check("c", lambda evidence: seen.append(evidence.laptop.get(fact)) or (), laptop=(fact,))
    laptop = machine({"words": Output(0, "four")})
    config = Config(tmp_path / "lupin.toml")
    # Nothing listens on port 1 of loopback: each robot is refused at once.
    robots = [Robot(f"pot-{n}", {"wired": f"127.0.0.{n}:1"}) for n in range(1, 6)]
    examinations = [Examination([check], (), laptop, robot, config) for robot in robots]
    examine_all(examinations)
    assert laptop.asked == [["words"]] and read == ["four"]
    assert seen == ["four"] * 5
    assert [each.link.kind for each in examinations if each.link] == ["refused"] * 5
    assert [each.link.robot for each in examinations if each.link] == [robot.name for robot in robots]


def test_a_robot_that_is_examined_again_asks_this_machine_again(machine) -> None:
    fact = Fact("words", "echo words", lambda output: output.stdout)
    laptop = machine({"words": Output(0, "four")})
    examination = Examination([Check("c", lambda evidence: (), laptop=(fact,))], (), laptop)
    examination.examine()
    examination.examine()
    assert laptop.asked == [["words"], ["words"]]


def test_a_closer_look_is_taken_only_where_something_was_found_and_all_checks_judge_anew(machine) -> None:
    symptom = Fact("symptom", "echo", lambda output: output.stdout)
    dear = Fact("dear", "sleep 5", lambda output: output.stdout)

    def find(evidence):
        if evidence.laptop.get(symptom) == "sick":
            yield Finding(
                "ache", Severity.PROBLEM, "laptop", "s", "c", (evidence.laptop.get(dear) or "not asked",), Fix("rest")
            )

    check = Check("ache", find, laptop=(symptom,), closer_laptop=(dear,))
    well = machine({"symptom": Output(0, "well"), "dear": Output(0, "seen")})
    assert Examination([check], (), well).examine().roots == ()
    assert well.asked == [["symptom"]]
    sick = machine({"symptom": Output(0, "sick"), "dear": Output(0, "seen")})
    examination = Examination([check], (), sick)
    (root,) = examination.examine().roots
    assert root.finding.evidence == ("seen",)
    assert examination.evidence is not None
    assert set(examination.evidence.laptop.outputs) == {"symptom", "dear"}
    assert sick.asked == [["symptom"], ["dear"]]


def test_what_a_closer_look_finds_well_is_well(machine) -> None:
    answers = iter(("sick", "well"))
    fact = Fact("symptom", "echo", lambda output: next(answers))

    def find(evidence):
        if evidence.laptop.get(fact) == "sick":
            yield Finding("ache", Severity.PROBLEM, "laptop", "s", "c", ("line",), Fix("rest"))

    check = Check("ache", find, laptop=(fact,), closer_laptop=(fact,))
    assert Examination([check], (), machine({"symptom": Output(0, "")})).examine().roots == ()
