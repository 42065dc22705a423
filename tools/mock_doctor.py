"""The doctor of the page's mock: findings of the doctor's table and playbooks that Lupin ships, as `--json` prints them."""

from __future__ import annotations

from typing import Any

from lupin_cli.checks import table
from lupin_cli.checks.findings import make_finding
from lupin_cli.doctor.engine import Diagnosis, RootCause
from lupin_cli.doctor.report import to_dict
from lupin_cli.playbook import playbook_files
from lupin_cli.playbook.results import Result, StepResult

ROOTS = (
    RootCause(
        make_finding(
            "clock-drift",
            where="robot",
            cause="The robot's clock is 3.4 s behind the laptop's.",
            evidence=("robot: 2026-11-24T07:10:02.118", "laptop: 2026-11-24T07:10:05.522 ± 0.004 s"),
            command="lupin sync-clock --robot greenhouse",
        ),
        (
            make_finding(
                "topic-silent",
                where="robot",
                cause="Nothing was received on /scan for 4.1 s.",
                evidence=("/scan: 0 samples in 4.1 s, publisher rplidar_node",),
                command="lupin logs slam",
            ),
            make_finding(
                "stamps-wrong",
                where="robot",
                cause="The stamps of /scan are 3.4 s old.",
                evidence=("/scan: stamps between 3.38 and 3.46 s before their receipt",),
                command="lupin doctor --robot greenhouse",
            ),
        ),
    ),
    RootCause(
        make_finding(
            "shared-memory-orphans",
            where="laptop",
            cause="Two dead processes left shared memory behind.",
            evidence=("fastrtps_port7412: no process", "fastrtps_port7414: no process"),
            command="lupin sweep --local",
        )
    ),
    RootCause(
        make_finding(
            "battery-low",
            where="robot",
            cause="The battery is at 31 % and lasts for about 20 minutes.",
            evidence=("/io/power/power_watcher: 11.02 V, 31 %",),
            instruction="charge the battery",
        )
    ),
)


def answers() -> dict[str, Any]:
    """The diagnosis, and the result of each fix in it that a playbook makes, by the playbook's name."""
    diagnosis = Diagnosis(checks=tuple(check.name for check in table.built_in()), roots=ROOTS)
    playbooks = [root.finding.fix.playbook for root in ROOTS if root.finding.fix.playbook]
    return {"diagnosis": to_dict(diagnosis), "fixes": {name: _result(name).plain() for name in playbooks}}


def _result(name: str) -> Result:
    """The result of a playbook's dry run in which every step would change something."""
    playbook = playbook_files.load(name)
    steps = (
        StepResult(index, step.name, step.operation.__name__, step.machine, "would-change", duration_s=0.4)
        for index, step in enumerate(playbook.steps)
    )
    return Result(playbook.name, "greenhouse", "done", tuple(steps), dry_run=True)
