"""The environment that the robot's units and their processes have: whether it leads them to another graph."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.dds_environment import domains_in_use, misleading_variables
from lupin_cli.checks.findings import NEED_VENDOR, make_finding
from lupin_cli.checks.layers import DRIVE, EVERYTHING, LUPIN
from lupin_cli.checks.remote_command import command_on_robot, remove_assignments
from lupin_cli.checks.services import UNIT_DOWN, lost_with, unit_evidence
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.shell import SHELL
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.units import UNIT_STATES, VENDOR
from lupin_cli.systemd.units import ONBOARD

_OF_ENVIRONMENT = ("rmw-mismatch", "process-multicast-only", "shell-other-graph")


def find_unit_environment(snapshot: Snapshot) -> Iterator[Finding]:
    """A unit's files set a variable with which its processes join another graph, or cannot start."""
    units, domains = snapshot.robot_fact(UNIT_STATES), _domains_of_laptop(snapshot)
    for name in (VENDOR, ONBOARD):
        unit = units.get(name) if units is not None else None
        found = misleading_variables(unit.environment, domains) if unit is not None else {}
        if unit is None or not found:
            continue
        files = [file for each in found for file in unit.files_setting(each, unit.environment[each])]
        yield make_finding(
            "unit-environment",
            where="robot",
            severity=_severity_in_effect(snapshot),
            cause="; ".join(f"{name} sets {each}={unit.environment[each]}: {reason}" for each, reason in found.items()),
            evidence=(
                *(f"systemctl show -p Environment {name}: {each}={unit.environment[each]}" for each in found),
                *(f"set by: {file}" for file in dict.fromkeys(files)),
                *unit_evidence(snapshot, unit),
            ),
            **remove_assignments(snapshot, unit, found),
            explains={*_OF_ENVIRONMENT, *(f"{id}:{name}" for id in UNIT_DOWN)}
            | (NEED_VENDOR | {"vendor-service-down"} if name == VENDOR else {"bus-locked"}),
            about=name,
            breaks=(EVERYTHING,) if name == VENDOR else (LUPIN, DRIVE),
        )


def _domains_of_laptop(snapshot: Snapshot) -> frozenset[int] | None:
    """Return the DDS domains of the laptop's programs and of this shell; None if that of the shell is not known."""
    shell = snapshot.laptop.get(SHELL)
    return None if shell is None else domains_in_use(snapshot.laptop) | {shell.domain}


def _severity_in_effect(snapshot: Snapshot) -> Severity:
    """Return the severity of a variable that leads to another graph: while all data arrives, it has no effect yet."""
    works = ground_truth.measure(snapshot).state is ground_truth.State.HEALTHY
    return Severity.WARNING if works else Severity.PROBLEM


def find_process_environment(snapshot: Snapshot) -> Iterator[Finding]:
    """Processes of the robot have a variable with which they join another graph, wherever it was set."""
    units, domains = snapshot.robot_fact(UNIT_STATES), _domains_of_laptop(snapshot)
    by_unit: dict[str, list[tuple[RosProcess, dict[str, str]]]] = {}
    for process in snapshot.robot_fact(ROS_PROCESSES) or ():
        unit = process.group.rpartition("/")[2]
        found = misleading_variables(process.environment, domains)
        found.pop("RMW_IMPLEMENTATION", None)  # a finding of its own
        if found and unit in (VENDOR, ONBOARD) and not process.is_server:
            by_unit.setdefault(unit, []).append((process, found))
    for unit, members in by_unit.items():
        in_file = units.get(unit) if units is not None else None
        if in_file is not None and misleading_variables(in_file.environment, domains):
            continue  # the unit's files set it: a finding of its own
        process, found = members[0]
        yield make_finding(
            "process-environment",
            where="robot",
            severity=_severity_in_effect(snapshot),
            cause="; ".join(f"processes of {unit} have {name}={process.environment[name]}: {found[name]}" for name in found),
            evidence=[each.line(*reasons) for each, reasons in members[:4]],
            command=command_on_robot(
                snapshot, f"grep -nE '{'|'.join(found)}' ~/.mirte_settings.sh ~/.bashrc ~/.profile /etc/environment"
            ),
            explains={*_OF_ENVIRONMENT, *(NEED_VENDOR if unit == VENDOR else {"bus-locked"})},
            about=unit,
            breaks=lost_with(unit),
        )


CHECKS = (
    Check("units.environment", find_unit_environment, laptop=(SHELL, ROS_PROCESSES), robot=(UNIT_STATES, SYSTEM_JOURNAL)),
    Check("units.processes", find_process_environment, laptop=(SHELL, ROS_PROCESSES), robot=(ROS_PROCESSES, UNIT_STATES)),
)
