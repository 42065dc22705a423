"""Files in `cases/`: captured facts that replace those of the healthy machines, and the root causes that all checks must find.

    {"laptop": {FACT: CASE}, "robot": {FACT: CASE}, "expected": [FINDING, ...]}

CASE is a captured output of tests/lupin_cli/facts/captured/FACT/. Other facts are those of a healthy laptop and robot, and
`expected` lists the findings in the order in which the doctor prints them.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lupin_cli.checks.table import built_in
from lupin_cli.doctor.engine import diagnose
from tests.support.finding_proofs import PROOFS
from tests.support.findings import assert_findings_match_rows
from tests.support.snapshots import HEALTHY_LAPTOP, HEALTHY_ROBOT, snapshot_of

CASES = sorted((Path(__file__).parent / "cases").glob("*.json"))


@pytest.mark.parametrize("file", CASES, ids=lambda file: file.stem)
def test_captured_fault_is_named_alone(file: Path) -> None:
    case = json.loads(file.read_text(encoding="utf-8"))
    assert set(case) <= {"laptop", "robot", "expected"}
    snapshot = snapshot_of({**HEALTHY_LAPTOP, **case.get("laptop", {})}, {**HEALTHY_ROBOT, **case.get("robot", {})})
    diagnosis = diagnose(built_in(), snapshot)
    assert_findings_match_rows(diagnosis)
    assert [root.finding.id for root in diagnosis.roots] == case["expected"]
    for finding in diagnosis.findings:
        assert finding.evidence and all(finding.evidence), finding.id


def test_every_finding_proven_by_a_case_has_one() -> None:
    expected = {finding for file in CASES for finding in json.loads(file.read_text(encoding="utf-8"))["expected"]}
    assert {name for name, proof in PROOFS.items() if "/test_captured_cases.py::" in proof.test} <= expected
