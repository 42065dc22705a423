"""Compares what checks return with the table of findings."""

from __future__ import annotations

from lupin_cli.checks.findings import FINDINGS
from lupin_cli.doctor.engine import Diagnosis

ROWS = {row.id: row for row in FINDINGS}


def assert_findings_match_rows(diagnosis: Diagnosis) -> None:
    """Assert that no check failed, and that each finding came from the check in its row of the table."""
    assert diagnosis.check_errors == ()
    for check, findings in diagnosis.by_check.items():
        for finding in findings:
            assert ROWS[finding.id].check == check, finding.id
            assert finding.symptom and finding.cause, finding.id
            assert finding.fix.playbook or not finding.fix.safe, finding.id
