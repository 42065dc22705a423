"""How a diagnosis of a generated case is judged: by ground truth, and by what its faults touch."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bench import bench_generated
from bench.bench_generated import Result, Row, count_by_row, format_result, load_log, to_figures
from bench.faults.fault import LAPTOP, LAYERS, LINK, ROBOT, Effect, Fault
from bench.generated_cases import (
    Case,
    Judgement,
    Truth,
    accepted_roots,
    draw_case,
    fix_errors,
    judge,
    required_faults,
    table_row_name,
)
from bench.runner import to_plain

CASES = st.builds(draw_case, st.integers(0, 1000), st.integers(0, 1000))
TRUTHS = st.builds(Truth, st.sampled_from([(), ("/scan: 0 samples",)]), st.booleans())


def fault(layer: str, machine: str, effect: Effect = Effect.BREAKS, part: str = "", hides_robot: bool = False) -> Fault:
    return Fault("drop", f"{layer} of {machine}", part or layer, layer, machine, effect, hides_robot=hides_robot)


HARMLESS = Fault("drop", "nothing", "nothing", "", "", Effect.NOTHING)
FINE, BROKEN, LOCKED_OUT = Truth((), True), Truth(("/scan: 0 samples, 0.0 Hz",), True), Truth((), False)


def case_of(*faults: Fault) -> Case:
    return Case(0, 0, faults)


def report(*roots: tuple[str, str], status: int | None = None, warnings: tuple[tuple[str, str], ...] = ()) -> dict[str, Any]:
    findings = [
        {"id": f"{layer}-x", "layer": layer, "machine": machine, "severity": severity, "consequences": []}
        for severity, given_roots in (("problem", roots), ("warning", warnings))
        for layer, machine in given_roots
    ]
    state = "broken" if roots else "healthy"
    return {
        "status": (1 if roots or warnings else 0) if status is None else status,
        "findings": findings,
        "ground_truth": {"state": state},
        "fixes": [],
    }


@given(CASES, TRUTHS)
def test_diagnosis_that_names_what_was_touched_is_right(case: Case, truth: Truth) -> None:
    assume(truth.fine or case.layers)  # nothing that a harmless case touches explains a broken truth
    roots = {(each.layer, each.machine) for each in required_faults(case, truth)}
    if not truth.fine and not roots:
        roots = {(each.layer, each.machine) for each in case.faults if each.layer}
    assert judge(case, truth, report(*roots)).right


@given(CASES, st.sampled_from(LAYERS), st.sampled_from([LAPTOP, ROBOT, LINK]), TRUTHS)
def test_root_that_nothing_touched_is_wrong(case: Case, layer: str, machine: str, truth: Truth) -> None:
    assume(all((layer, machine) not in accepted for accepted in accepted_roots(case).values()))
    judgement = judge(case, truth, report((layer, machine)))
    assert not judgement.machine_right
    assert judgement.root_while_fine == (truth.fine and truth.login)


@given(CASES)
def test_healthy_while_broken_is_never_right(case: Case) -> None:
    judgement = judge(case, BROKEN, report())
    assert judgement.healthy_while_broken
    assert not judgement.right
    state_alone = {**report(status=4), "ground_truth": {"state": "healthy"}}
    assert judge(case, BROKEN, state_alone).healthy_while_broken


def test_harmless_case_may_have_advice_but_no_root() -> None:
    case = case_of(HARMLESS)
    assert judge(case, FINE, report()).right
    assert judge(case, FINE, report(warnings=(("machine", ROBOT),))).right
    judgement = judge(case, FINE, report(("ports", LAPTOP)))
    assert judgement.root_while_fine and not judgement.right
    assert table_row_name(case) == "harmless"


def test_advice_does_not_explain_a_broken_truth() -> None:
    judgement = judge(case_of(fault("ports", ROBOT)), BROKEN, report(warnings=(("ports", ROBOT),)))
    assert not judgement.root_right


def test_layer_and_machine_are_judged_separately() -> None:
    judgement = judge(case_of(fault("ports", ROBOT)), BROKEN, report(("ports", LAPTOP)))
    assert judgement.root_right and not judgement.machine_right
    assert judgement.expected == ("ports@robot",) and judgement.named == ("ports@laptop",)


def test_two_independent_faults_are_two_roots() -> None:
    case = case_of(fault("profile", LAPTOP), fault("processes", ROBOT))
    assert judge(case, BROKEN, report(("profile", LAPTOP), ("processes", ROBOT))).right
    assert not judge(case, BROKEN, report(("profile", LAPTOP))).root_right


def test_fault_that_may_break_is_required_only_alone() -> None:
    doubtful = fault("loss", LINK, Effect.MAY_BREAK)
    assert required_faults(case_of(doubtful), BROKEN) == (doubtful,)
    assert required_faults(case_of(doubtful, HARMLESS), BROKEN) == (doubtful,)
    assert required_faults(case_of(doubtful, fault("profile", LAPTOP)), BROKEN) == (case_of(fault("profile", LAPTOP)).faults)
    assert required_faults(case_of(doubtful), FINE) == ()
    two = case_of(doubtful, fault("environment", LAPTOP, Effect.MAY_BREAK))
    assert not judge(two, BROKEN, report(status=4)).root_right  # one of both must be named
    assert judge(two, BROKEN, report(("environment", LAPTOP))).right


def test_fault_on_a_hidden_robot_is_not_required() -> None:
    cut = fault("carrier", LINK, part="cable", hides_robot=True)
    case = case_of(fault("processes", ROBOT), cut)
    assert required_faults(case, Truth(BROKEN.broken, False)) == (cut,)
    assert judge(case, Truth(BROKEN.broken, False), report(("carrier", LINK))).right


@pytest.mark.parametrize(
    ("hidden", "required"),
    [
        (fault("ports", ROBOT, part="cable"), False),
        (fault("ports", LINK, part="cable"), False),
        (fault("loss", LINK, part="cable"), True),
        (fault("ports", LAPTOP, part="cable"), True),
        (fault("discovery", ROBOT), False),
        (fault("carrier", ROBOT, part="cable", hides_robot=True), True),
    ],
)
def test_without_login_only_what_the_laptop_sees_is_required(hidden: Fault, required: bool) -> None:
    locked = fault("login", ROBOT, hides_robot=True)
    truth = Truth(BROKEN.broken, False)
    case = case_of(hidden, locked)
    assert (hidden in required_faults(case, truth)) is required
    symptom = report(("login", ROBOT), ("samples", LINK), status=3)  # silence that nothing explains
    assert judge(case, truth, symptom).right is not required


def test_filter_that_drops_a_fraction_is_loss_or_a_filter() -> None:
    case = case_of(replace(fault("loss", ROBOT, part="cable"), also_layer="ports"))
    for layer in ("loss", "ports"):
        assert judge(case, BROKEN, report((layer, ROBOT))).right
    assert not judge(case, BROKEN, report(("ports", LINK))).machine_right


@pytest.mark.parametrize("root", [("carrier", LINK), ("address", ROBOT), ("route", LINK)])
def test_silent_ends_of_a_dead_link_look_the_same(root: tuple[str, str]) -> None:
    case = case_of(fault("address", ROBOT, part="cable", hides_robot=True))
    assert judge(case, Truth(BROKEN.broken, False), report(root)).right
    assert not judge(case, Truth(BROKEN.broken, False), report((root[0], LAPTOP))).machine_right
    # The laptop can always be examined.
    own = case_of(fault("address", LAPTOP, part="cable", hides_robot=True))
    assert judge(own, Truth(BROKEN.broken, False), report(root)).right is False


def test_lost_login_is_required_and_is_no_root_while_fine() -> None:
    case = case_of(fault("login", ROBOT, hides_robot=True))
    assert judge(case, LOCKED_OUT, report(("login", ROBOT), status=3)).right
    assert not judge(case, LOCKED_OUT, report(status=4)).root_right
    assert judge(case, FINE, report()).right  # the file was not needed


def test_fix_must_not_make_truth_worse_or_claim_health() -> None:
    healed = report()
    assert fix_errors(BROKEN, FINE, healed) == ()
    assert fix_errors(BROKEN, BROKEN, report(("ports", ROBOT))) == ()
    assert "said to be healed" in fix_errors(BROKEN, BROKEN, healed)[0]
    assert "worse" in fix_errors(FINE, BROKEN, report(("ports", ROBOT)))[0]
    assert "worse" in fix_errors(BROKEN, Truth((*BROKEN.broken, "/tf: 0 samples"), True), report(("ports", ROBOT)))[0]
    assert "no login" in fix_errors(FINE, LOCKED_OUT, report(("login", ROBOT)))[0]
    marked = {**report(("ports", ROBOT)), "fixes": [{"finding": "ports-x", "machine": ROBOT, "state": "healed"}]}
    assert "marked healed" in fix_errors(BROKEN, BROKEN, marked)[0]
    warned = {**report(status=1), "fixes": marked["fixes"]}
    assert "no other problem is named" in fix_errors(BROKEN, BROKEN, warned)[0]
    assert fix_errors(BROKEN, BROKEN, {**report(("loss", LINK)), "fixes": marked["fixes"]}) == ()


def results() -> list[Result]:
    right = Judgement(("ports@robot",), ("ports@robot",), root_right=True, machine_right=True)
    wrong = Judgement(("loss@link",), (), root_right=False, machine_right=False, healthy_while_broken=True)
    return [
        Result(0, 1, "drop: a", "ports", (("robot", "nft"),), BROKEN, right, status=1, took_s=2.5),
        Result(0, 4, "drop: b", "loss", (), BROKEN, wrong, status=0, took_s=1.0),
        Result(0, 5, "drop: c", "loss", error="RigError: no"),
    ]


def test_log_restores_the_results_of_its_seed(tmp_path: Path) -> None:
    log = tmp_path / "log"
    assert load_log(log, 0) == []
    log.write_text("".join(json.dumps(asdict(result)) + "\n" for result in results()))
    restored = load_log(log, 0)
    assert [json.dumps(asdict(result)) for result in restored] == [json.dumps(asdict(result)) for result in results()]
    assert load_log(log, 1) == [] and load_log(log, 0, cable_only=True) == []
    assert count_by_row(restored) == count_by_row(results())


def test_table_counts_by_layer_and_fails_below_the_target() -> None:
    rows = count_by_row(results())
    assert list(rows) == ["loss", "ports", "all"]
    assert rows["loss"] == Row(cases=1, broken=1, healthy_while_broken=1, errors=1, slowest_s=1.0)
    assert rows["all"] == Row(2, 2, 1, 1, healthy_while_broken=1, errors=1, slowest_s=2.5)
    assert "WRONG" in format_result(results()[1]) and "NOT MEASURED" in format_result(results()[2])


@pytest.mark.parametrize(
    ("row", "passed"),
    [
        (Row(20, 15, 19, 19), True),
        (Row(20, 15, 18, 20), False),
        (Row(20, 15, 20, 18), False),
        (Row(20, 15, 20, 20, healthy_while_broken=1), False),
        (Row(20, 15, 20, 20, root_while_fine=1), False),
        (Row(20, 15, 20, 20, fix_errors=1), False),
        (Row(20, 15, 20, 20, errors=1), False),
        (Row(20, 15, 20, 20, late=1), False),
        (Row(19, 15, 19, 19), False),
        (Row(), False),
    ],
)
def test_target_is_95_percent_and_no_false_statement(row: Row, passed: bool) -> None:
    figures = to_plain(to_figures({"all": row}, 20))
    assert all(check.met for check in bench_generated.main.compare(figures).values()) is passed
