"""How well `lupin doctor` finds and fixes faults of a booted robot: each fault alone, combinations of faults, and no fault.

An injected fault is found if its finding is reported, as a root cause or as a consequence of another fault. Every other root
cause is a false positive. Then `--fix` plays the safe fixes, and with `--yes` also those that ask for confirmation. The faults
are healed if the doctor afterwards reports only findings for which no fix was played.

Needs root, as the tests on booted hosts do. All faults are injected into one host, which is replaced if it does not recover.
"""

from __future__ import annotations

import fnmatch
import json
import random
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, fields
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any

from bench.fault_case import FaultCase
from bench.fault_rig import FaultRig, RigError
from bench.fault_table import CASES
from bench.runner import Figures, LimitS, Log, Patterns, Seed, append_to_log, benchmark, note
from lupin_cli.exit_codes import SUCCESS, UNREACHABLE
from lupin_sim.host import HostError

# Faults of these groups are injected after all others, in this order: other faults restart the stack, which removes stale
# resources, and missing software or a full disk can prevent other faults from being injected.
INJECTION_ORDER = {"stale-resources": 1, "software": 2, "disk": 3}
REPEAT_TIMEOUT_S = 10.0  # some faults become visible only after a DDS lease has expired or chrony has polled


@dataclass
class FaultResult:
    """The doctor's findings for one fault, or for several faults at the same time. Findings are given by their ids."""

    faults: tuple[str, ...]
    expected: tuple[str, ...]
    as_root_cause: tuple[str, ...] = ()  # expected, and reported as a root cause
    as_consequence: tuple[str, ...] = ()  # expected, and reported only as a consequence
    missed: tuple[str, ...] = ()
    false_positives: tuple[str, ...] = ()
    diagnoses: int = 0  # how often the doctor ran until nothing was missed
    took_s: float = 0.0
    healed: bool | None = None  # by --fix; None if no fix was played
    remaining: tuple[str, ...] = ()  # root causes after --fix, without those for which no fix was played
    played: tuple[str, ...] = ()  # playbooks and their states
    error: str = ""
    finding_lines: tuple[str, ...] = field(default=(), repr=False)  # cause and evidence of every root cause

    @property
    def correct(self) -> bool:
        """Whether the doctor reported everything that was expected, and nothing else."""
        return not (self.missed or self.false_positives or self.error)


def score(result: FaultResult, report: dict[str, Any]) -> None:
    """Compare a report with the expected findings, and store the outcome in `result`."""
    root_causes = {finding["id"] for finding in report["findings"]}
    consequences = {finding["id"] for root in report["findings"] for finding in root["consequences"]}
    expected = set(result.expected)
    result.as_root_cause = tuple(sorted(expected & root_causes))
    result.as_consequence = tuple(sorted((expected & consequences) - root_causes))
    result.missed = tuple(sorted(expected - root_causes - consequences))
    result.false_positives = tuple(sorted(root_causes - expected))
    # Facts of a robot that cannot be reached are unknown; that is no error of the doctor.
    gaps = report["broken"] if report["status"] == UNREACHABLE else [*report["unknown"], *report["broken"]]
    result.error = "; ".join(gaps)
    result.took_s = report["took_s"]
    result.finding_lines = tuple(f"{f['id']}: {f['cause']} | {' | '.join(f['evidence'][:4])}" for f in report["findings"])


def diagnose(rig: FaultRig, cases: Sequence[FaultCase], result: FaultResult) -> dict[str, Any]:
    """Run the doctor until no expected finding is missing, or REPEAT_TIMEOUT_S is over; return the last report."""
    shell = next((case.shell for case in cases if case.shell != "sourced"), "sourced")
    deadline = time.monotonic() + REPEAT_TIMEOUT_S
    while True:
        result.diagnoses += 1
        report = rig.run_doctor(env=rig.environments[shell], robot=cases[0].robot)
        score(result, report)
        if not result.missed or time.monotonic() > deadline:
            return report


def repair(rig: FaultRig, cases: Sequence[FaultCase], result: FaultResult, report: dict[str, Any], yes: bool) -> None:
    """Run the doctor with --fix, and store in `result` what was played and what remains."""
    to_play = [finding for finding in report["findings"] if finding["fix"]["playbook"] and (yes or finding["fix"]["safe"])]
    if not to_play:
        return
    shell = next((case.shell for case in cases if case.shell != "sourced"), "sourced")
    words = ["--fix", *(["--yes"] if yes else [])]
    after = rig.run_doctor(*words, env=rig.environments[shell], robot=cases[0].robot)
    reported = {finding["id"] for root in report["findings"] for finding in (root, *root["consequences"])}
    without_fix = reported - {finding["id"] for finding in to_play}
    result.played = tuple(f"{t['playbook']}: {t['state']}" for t in after["fixes"])
    result.remaining = tuple(sorted({finding["id"] for finding in after["findings"]} - without_fix))
    result.healed = not result.remaining and not after["unknown"] and not after["broken"]
    if not result.healed:
        result.finding_lines += tuple(
            f"after --fix {f['id']}: {f['cause']} | {' | '.join(f['evidence'][:4])}" for f in after["findings"]
        )


def measure(rig: FaultRig, cases: Sequence[FaultCase], yes: bool) -> tuple[FaultResult, str]:
    """Inject the faults, diagnose, fix, undo, and wait until the doctor finds nothing.

    Returns the result, and why the machines did not recover ("" if they did).
    """
    expected = tuple(sorted(frozenset().union(*(case.expected for case in cases))))
    result = FaultResult(tuple(case.name for case in cases), expected)
    recovery_error, injected = "", []
    try:
        for case in sorted(cases, key=lambda case: INJECTION_ORDER.get(case.exclusive_group, 0)):
            injected.append(case)
            case.inject(rig)
        repair(rig, cases, result, diagnose(rig, cases, result), yes)
    except (RigError, HostError, subprocess.TimeoutExpired) as error:
        result.error = f"{type(error).__name__}: {error}"[:400]
    for case in reversed(injected):
        try:
            case.undo(rig)
        except (RigError, HostError, subprocess.TimeoutExpired) as error:
            recovery_error = recovery_error or f"{case.name} could not be undone: {error}"[:300]
    try:
        rig.restore()
        rig.wait_until_healthy()
    except (RigError, HostError, subprocess.TimeoutExpired) as error:
        recovery_error = f"after {' and '.join(result.faults)}: {recovery_error or error}"[:600]
    return result, recovery_error


def compatible_pairs(cases: Sequence[FaultCase]) -> list[tuple[FaultCase, FaultCase]]:
    """Return the pairs whose faults can exist at the same time."""
    return [pair for pair in combinations(cases, 2) if pair[0].is_compatible(pair[1])]


def pair_names(pair: tuple[FaultCase, FaultCase]) -> tuple[str, ...]:
    """Return the sorted names of a pair."""
    return tuple(sorted(case.name for case in pair))


def plan_combinations(
    cases: Sequence[FaultCase], size: int, seed: int, covered: Collection[tuple[str, ...]] = ()
) -> list[tuple[FaultCase, ...]]:
    """Return combinations of up to `size` compatible faults that contain every compatible pair, except those in `covered`.

    A fault that hides another in a pair also hides it in a larger combination. So if all faults of a combination are found, its
    pairs are covered.
    """
    position = {case.name: index for index, case in enumerate(cases)}
    uncovered = {
        (position[one.name], position[other.name])
        for one, other in compatible_pairs(cases)
        if pair_names((one, other)) not in covered
    }
    rng = random.Random(seed)
    plan = []
    while uncovered:
        chosen = [*rng.choice(sorted(uncovered))]
        others = [index for index in range(len(cases)) if index not in chosen]
        rng.shuffle(others)
        while len(chosen) < size:
            candidates = [i for i in others if i not in chosen and all(cases[i].is_compatible(cases[c]) for c in chosen)]
            if not candidates:
                break
            chosen.append(max(candidates, key=lambda i: sum(tuple(sorted((i, c))) in uncovered for c in chosen)))
        uncovered -= set(combinations(sorted(chosen), 2))
        plan.append(tuple(cases[index] for index in sorted(chosen)))
    return sorted(plan, key=len, reverse=True)


def covered_pairs_of_log(log: Path | None, cases: Sequence[FaultCase]) -> set[tuple[str, ...]]:
    """Return the pairs that the results in the log of an earlier run cover."""
    pairs: set[tuple[str, ...]] = set()
    for text in log.read_text().splitlines() if log is not None and log.exists() else ():
        report = json.loads(text)
        if "faults" in report:
            result = FaultResult(**{each.name: report[each.name] for each in fields(FaultResult) if each.name in report})
            pairs |= covered_pairs(result, [case for case in cases if case.name in result.faults])
    return pairs


def covered_pairs(result: FaultResult, cases: Sequence[FaultCase]) -> set[tuple[str, ...]]:
    """Return the pairs of which both faults were found; none if the doctor reported anything else."""
    if result.false_positives or result.error:
        return set()
    found = {*result.as_root_cause, *result.as_consequence}
    return set(map(pair_names, compatible_pairs([case for case in cases if case.expected <= found])))


def diagnose_healthy(
    rig: FaultRig, count: int, at_once: int, on_report: Callable[[dict[str, Any]], object]
) -> list[dict[str, Any]]:
    """Diagnose a healthy robot `count` times, with `at_once` doctors at the same time; return the reports."""
    rig.wait_until_healthy()
    reports = []
    with ThreadPoolExecutor(max_workers=at_once) as pool:
        for future in as_completed([pool.submit(rig.run_doctor) for _ in range(count)]):
            reports.append(future.result())
            on_report(reports[-1])
    return reports


def format_line(result: FaultResult) -> str:
    """Return the result as one line of text."""
    mark = "ok" if result.correct else "WRONG"
    parts = [f"{mark:6}{' + '.join(result.faults):58}  {','.join(result.as_root_cause) or '-'}"]
    for label, ids in (
        ("consequences", result.as_consequence),
        ("missed", result.missed),
        ("false positives", result.false_positives),
    ):
        if ids:
            parts.append(f"{label} {','.join(ids)}")
    if result.healed is not None:
        parts.append("healed" if result.healed else f"NOT HEALED: {','.join(result.remaining)} ({'; '.join(result.played)})")
    if result.error:
        parts.append(f"error {result.error}")
    return "  ".join([*parts, f"{result.diagnoses}x {result.took_s:.1f} s"])


def count_results(results: Sequence[FaultResult]) -> dict[str, Any]:
    """Count results; `expected` to `false_positives` count findings."""
    fix_attempted = [result for result in results if result.healed is not None]
    return {
        "results": len(results),
        "correct": sum(result.correct for result in results),
        "expected": sum(len(result.expected) for result in results),
        "as_root_cause": sum(len(result.as_root_cause) for result in results),
        "as_consequence": sum(len(result.as_consequence) for result in results),
        "missed": sum(len(result.missed) for result in results),
        "false_positives": sum(len(result.false_positives) for result in results),
        "errors": sum(bool(result.error) for result in results),
        "fix_attempted": len(fix_attempted),
        "healed": sum(bool(result.healed) for result in fix_attempted),
        "not_healed": sum(not result.healed for result in fix_attempted),
    }


def start_rig() -> FaultRig:
    """Boot a rig, and wait until the doctor finds nothing."""
    rig = FaultRig.start()
    try:
        rig.wait_until_healthy()
    except BaseException:
        rig.stop()
        raise
    return rig


@benchmark(at_most=dict.fromkeys(("missed", "false_positives", "errors", "not_healed", "healthy_wrong"), 0), long=True)
def main(
    only: Patterns = (),
    no_singles: Annotated[bool, "do not inject each fault alone"] = False,
    pairs: Annotated[int, "inject this many random pairs of faults"] = 0,
    together: Annotated[int, "cover every pair that --log does not have by injecting up to this many faults at a time"] = 0,
    healthy: Annotated[int, "diagnose the healthy robot this many times"] = 0,
    beside: Annotated[int, "diagnose the healthy robot with this many doctors at the same time"] = 1,
    seed: Seed = 0,
    yes: Annotated[bool, "also play the fixes that ask for confirmation"] = False,
    limit_s: LimitS = 3300.0,
    log: Log = None,
) -> Figures:
    """Inject the chosen faults, diagnose and fix them."""
    began = time.monotonic()
    chosen = [case for case in CASES if not only or any(fnmatch.fnmatch(case.name, pattern) for pattern in only)]
    possible_pairs = compatible_pairs(chosen)
    drawn = random.Random(seed).sample(possible_pairs, min(pairs, len(possible_pairs)))
    covered = covered_pairs_of_log(log, chosen)
    larger = plan_combinations(chosen, together, seed, covered) if together else []
    plan: list[tuple[FaultCase, ...]] = [*([] if no_singles else [(case,) for case in chosen]), *drawn, *larger]
    singles: list[FaultResult] = []
    combined: list[FaultResult] = []
    healthy_reports: list[dict[str, Any]] = []
    reboots = 0
    rig = start_rig()
    try:
        for cases in plan:
            if time.monotonic() - began > limit_s:
                note(f"--limit-s is over; not injected: {len(plan) - len(singles) - len(combined)}")
                break
            result, recovery_error = measure(rig, cases, yes)
            (singles if len(cases) == 1 else combined).append(result)
            covered |= covered_pairs(result, cases)
            note(format_line(result))
            append_to_log(log, asdict(result) | {"recovery_error": recovery_error})
            if recovery_error:
                note(f"  booting a new host: {recovery_error}")
                reboots += 1
                rig.stop()
                rig = start_rig()
        if healthy:
            healthy_reports = diagnose_healthy(rig, healthy, beside, lambda report: append_to_log(log, report))
    finally:
        rig.stop()
    wrong_healthy_reports = [report for report in healthy_reports if report["status"] != SUCCESS]
    for report in wrong_healthy_reports:
        details = f"{report['findings']} {report['unknown']} {report['broken']}"
        note(f"the doctor exited with {report['status']} although the robot is healthy: {details}")
    return {
        "faults": len(chosen),
        "injected": {"alone": count_results(singles), "combined": count_results(combined)},
        "pairs_possible": len(possible_pairs),
        "pairs_covered": len(covered),
        "healthy_reports": len(healthy_reports),
        "healthy_wrong": len(wrong_healthy_reports),
        "healthy_with_findings": sum(bool(report["findings"]) for report in healthy_reports),
        "healthy_with_gaps": sum(bool(report["unknown"] or report["broken"]) for report in healthy_reports),
        "healthy_median_s": statistics.median(report["took_s"] for report in healthy_reports) if healthy_reports else None,
        "reboots": reboots,
        "minutes": (time.monotonic() - began) / 60.0,
    }


if __name__ == "__main__":
    sys.exit(main())
