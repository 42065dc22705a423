"""The doctor against a booted robot: every fault alone, then in pairs, then many runs without a fault.

A fault counts as named if its finding is a root cause, or a consequence of the other fault of a pair. Every other root cause
counts as false. `--fix` then plays the safe fixes, and the fault counts as healed if the doctor finds nothing afterwards. With
--yes, the fixes that ask a person are played too.

    python -m bench.bench_triage [--only PATTERN] [--pairs N | --together N] [--healthy N]
                                   [--seed N] [--yes] [--log FILE] [--json]

Needs root, as the tests on booted hosts do. All faults are injected into one host, which is rebooted if it does not recover.
"""

from __future__ import annotations

import argparse
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
from typing import Any

from bench.fault_rig import Rig, RigError
from bench.triage import CASES, Case
from lupin_sim.host import HostError

# Some faults restart the stack, which cleans up what others leave behind; a full disk prevents injecting the others.
INJECTED_LATE = {"stale-resources": 1, "software": 2, "disk": 3}
REPEAT_TIMEOUT_S = 10.0  # for faults that show late: a DDS lease, a poll of chrony


@dataclass
class FaultResult:
    """How the doctor judged one fault, or several at once."""

    faults: tuple[str, ...]
    expected: tuple[str, ...]
    named: tuple[str, ...] = ()  # as root causes
    folded: tuple[str, ...] = ()  # as consequences
    missed: tuple[str, ...] = ()
    false: tuple[str, ...] = ()
    runs: int = 0  # diagnoses until it was named
    took_s: float = 0.0
    healed: bool | None = None  # by --fix; None if no finding was safe to fix
    left: tuple[str, ...] = ()  # root causes after --fix
    played: tuple[str, ...] = ()
    error: str = ""
    lines: tuple[str, ...] = field(default=(), repr=False)  # causes of false and remaining findings

    @property
    def right(self) -> bool:
        """Whether everything was named and nothing else."""
        return not (self.missed or self.false or self.error)


def fill_in(result: FaultResult, report: dict[str, Any]) -> None:
    """Fill in which of the expected findings a report contains."""
    causes = [finding["id"] for finding in report["findings"]]
    folded = [finding["id"] for root in report["findings"] for finding in root["consequences"]]
    wanted = set(result.expected)
    result.named = tuple(sorted(wanted & set(causes)))
    result.folded = tuple(sorted((wanted & set(folded)) - set(causes)))
    result.missed = tuple(sorted(wanted - set(causes) - set(folded)))
    result.false = tuple(sorted(set(causes) - wanted))
    gaps = [*report["unknown"], *report["broken"]] if report["status"] != 3 else report["broken"]
    result.error = "; ".join(gaps)
    result.took_s = report["took_s"]
    result.lines = tuple(f"{f['id']}: {f['cause']} | {' | '.join(f['evidence'][:4])}" for f in report["findings"])


def diagnose(rig: Rig, cases: Sequence[Case], result: FaultResult) -> dict[str, Any]:
    """Run the doctor, again while a finding is missing: some faults show late."""
    shell = next((case.shell for case in cases if case.shell != "sourced"), "sourced")
    deadline = time.monotonic() + REPEAT_TIMEOUT_S
    while True:
        result.runs += 1
        report = rig.doctor(env=rig.shells[shell], robot=cases[0].robot)
        fill_in(result, report)
        if not result.missed or time.monotonic() > deadline:
            return report


def repair(rig: Rig, cases: Sequence[Case], result: FaultResult, report: dict[str, Any], yes: bool) -> None:
    """Run the doctor with --fix, and record what remains."""
    due = [finding for finding in report["findings"] if finding["fix"]["playbook"] and (yes or finding["fix"]["safe"])]
    if not due:
        return
    shell = next((case.shell for case in cases if case.shell != "sourced"), "sourced")
    words = ["--fix", *(["--yes"] if yes else [])]
    after = rig.doctor(*words, env=rig.shells[shell], robot=cases[0].robot)
    seen = {finding["id"] for root in report["findings"] for finding in (root, *root["consequences"])}
    left_to_person = seen - {finding["id"] for finding in due}
    result.played = tuple(f"{t['playbook']}: {t['state']}" for t in after["treatments"])
    result.left = tuple(sorted({finding["id"] for finding in after["findings"]} - left_to_person))
    result.healed = not result.left and not after["unknown"] and not after["broken"]
    if not result.healed:
        result.lines += tuple(f"left {f['id']}: {f['cause']} | {' | '.join(f['evidence'][:4])}" for f in after["findings"])


def attempt(rig: Rig, cases: Sequence[Case], yes: bool) -> tuple[FaultResult, str]:
    """Inject the faults, diagnose, fix, undo, and wait for health. Also returns why the rig is unusable, or nothing."""
    expected = tuple(sorted(frozenset().union(*(case.expected for case in cases))))
    result = FaultResult(tuple(case.name for case in cases), expected)
    broken, injected = "", []
    try:
        for case in sorted(cases, key=lambda case: INJECTED_LATE.get(case.group, 0)):
            injected.append(case)
            case.inject(rig)
        repair(rig, cases, result, diagnose(rig, cases, result), yes)
    except (RigError, HostError, subprocess.TimeoutExpired) as error:
        result.error = f"{type(error).__name__}: {error}"[:400]
    for case in reversed(injected):
        try:
            case.undo(rig)
        except (RigError, HostError, subprocess.TimeoutExpired) as error:
            broken = broken or f"{case.name} could not be undone: {error}"[:300]
    try:
        rig.restore()
        rig.until_healthy()
    except (RigError, HostError, subprocess.TimeoutExpired) as error:
        broken = f"after {' and '.join(result.faults)}: {broken or error}"[:600]
    return result, broken


def compatible_pairs(cases: Sequence[Case]) -> list[tuple[Case, Case]]:
    """The pairs whose faults can exist at the same time."""
    return [pair for pair in combinations(cases, 2) if pair[0].fits(pair[1])]


def pair_names(pair: tuple[Case, Case]) -> tuple[str, ...]:
    """The sorted names of a pair."""
    return tuple(sorted(case.name for case in pair))


def plan_groups(cases: Sequence[Case], size: int, seed: int, known: Collection[tuple[str, ...]] = ()) -> list[tuple[Case, ...]]:
    """Sets of up to `size` compatible faults that cover every compatible pair that is not in `known`.

    A fault that hides another in a pair also hides it in a larger set. A set in which all are named thus proves its pairs.
    """
    position = {case.name: index for index, case in enumerate(cases)}
    left = {
        (position[one.name], position[other.name])
        for one, other in compatible_pairs(cases)
        if pair_names((one, other)) not in known
    }
    chance = random.Random(seed)
    groups = []
    while left:
        first = chance.choice(sorted(left))
        group = [*first]
        others = [index for index in range(len(cases)) if index not in group]
        chance.shuffle(others)
        while len(group) < size:
            more = [index for index in others if index not in group and all(cases[index].fits(cases[g]) for g in group)]
            if not more:
                break
            group.append(max(more, key=lambda index: sum(tuple(sorted((index, g))) in left for g in group)))
        left -= set(combinations(sorted(group), 2))
        groups.append(tuple(cases[index] for index in sorted(group)))
    return sorted(groups, key=len, reverse=True)


def proven_pairs_of_log(log: Path | None, cases: Sequence[Case]) -> set[tuple[str, ...]]:
    """The pairs that the log of an earlier run proves."""
    pairs: set[tuple[str, ...]] = set()
    for text in log.read_text().splitlines() if log is not None and log.exists() else ():
        report = json.loads(text)
        if "faults" in report:
            result = FaultResult(**{each.name: report[each.name] for each in fields(FaultResult) if each.name in report})
            pairs |= proven_pairs(result, [case for case in cases if case.name in result.faults])
    return pairs


def proven_pairs(result: FaultResult, cases: Sequence[Case]) -> set[tuple[str, ...]]:
    """The pairs that a result proves: both faults were named, and nothing else."""
    if result.false or result.error:
        return set()
    found = {*result.named, *result.folded}
    return set(map(pair_names, compatible_pairs([case for case in cases if case.expected <= found])))


def healthy_runs(rig: Rig, count: int, beside: int, note: Callable[[dict[str, Any]], object]) -> list[dict[str, Any]]:
    """Diagnose a healthy robot `count` times, `beside` of them at the same time; `note` is called with each report."""
    rig.until_healthy()
    reports = []
    with ThreadPoolExecutor(max_workers=beside) as pool:
        for run in as_completed([pool.submit(rig.doctor) for _ in range(count)]):
            reports.append(run.result())
            note(reports[-1])
    return reports


def format_line(result: FaultResult) -> str:
    """One line of the matrix."""
    mark = "ok" if result.right else "WRONG"
    words = [f"{mark:6}{' + '.join(result.faults):58}  {','.join(result.named) or '-'}"]
    for label, value in (("folded", result.folded), ("missed", result.missed), ("false", result.false)):
        if value:
            words.append(f"{label} {','.join(value)}")
    if result.healed is not None:
        words.append("healed" if result.healed else f"NOT HEALED: {','.join(result.left)} ({'; '.join(result.played)})")
    if result.error:
        words.append(f"error {result.error}")
    return "  ".join([*words, f"{result.runs}x {result.took_s:.1f} s"])


def count_results(results: Sequence[FaultResult]) -> dict[str, Any]:
    """Counts over several results."""
    cured = [result for result in results if result.healed is not None]
    return {
        "runs": len(results),
        "right": sum(result.right for result in results),
        "causes": sum(len(result.expected) for result in results),
        "named": sum(len(result.named) for result in results),
        "folded": sum(len(result.folded) for result in results),
        "missed": sum(len(result.missed) for result in results),
        "false": sum(len(result.false) for result in results),
        "errors": sum(bool(result.error) for result in results),
        "safe": len(cured),
        "healed": sum(bool(result.healed) for result in cured),
    }


def main() -> int:
    """Inject the chosen faults, diagnose, and print what was named; return 1 for a wrong diagnosis or a robot left broken."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", action="append", default=[], metavar="PATTERN", help="these faults, alone and in pairs")
    parser.add_argument("--no-singles", action="store_true", help="pairs and healthy runs only")
    parser.add_argument("--pairs", type=int, default=0, metavar="N")
    parser.add_argument("--together", type=int, default=0, metavar="N", help="every pair, N faults at a time")
    parser.add_argument("--healthy", type=int, default=0, metavar="N")
    parser.add_argument("--beside", type=int, default=1, metavar="N", help="healthy runs at the same time")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--yes", action="store_true", help="play what asks a person, too")
    parser.add_argument("--limit-s", type=float, default=3300.0, help="nothing new is begun after this")
    parser.add_argument("--log", type=Path, help="every result as a line of JSON; pairs that it proves already are in no set")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    began = time.monotonic()
    chosen = [case for case in CASES if not options.only or any(fnmatch.fnmatch(case.name, only) for only in options.only)]
    possible = compatible_pairs(chosen)
    pairs = random.Random(options.seed).sample(possible, min(options.pairs, len(possible)))
    seen = proven_pairs_of_log(options.log, chosen)
    groups = plan_groups(chosen, options.together, options.seed, seen) if options.together else []
    plan: list[tuple[Case, ...]] = [*([] if options.no_singles else [(case,) for case in chosen]), *pairs, *groups]
    singles: list[FaultResult] = []
    combined: list[FaultResult] = []
    well: list[dict[str, Any]] = []
    output, reboots = sys.stderr if options.json else sys.stdout, 0
    rig = start_rig()
    try:
        for cases in plan:
            if time.monotonic() - began > options.limit_s:
                print(f"out of time: {len(plan) - len(singles) - len(combined)} left", file=output, flush=True)
                break
            result, broken = attempt(rig, cases, options.yes)
            (singles if len(cases) == 1 else combined).append(result)
            seen |= proven_pairs(result, cases)
            print(format_line(result), file=output, flush=True)
            append_to_log(options.log, asdict(result) | {"broken": broken})
            if broken:
                print(f"  rebooted: {broken}", file=output, flush=True)
                reboots += 1
                rig.end()
                rig = start_rig()
        if options.healthy:
            well = healthy_runs(rig, options.healthy, options.beside, lambda run: append_to_log(options.log, run))
    finally:
        rig.end()
    sick = [run for run in well if run["status"] != 0]
    for run in sick:
        print(
            f"healthy robot, but the doctor exited with {run['status']}: {run['findings']} {run['unknown']} {run['broken']}",
            file=output,
        )
    summary = {
        "faults": len(chosen),
        "alone": count_results(singles),
        "pairs_possible": len(possible),
        "pairs_right": len(seen),
        "together": count_results(combined),
        "healthy_runs": len(well),
        "healthy_with_findings": sum(bool(run["findings"]) for run in well),
        "healthy_not_fully_seen": sum(bool(run["unknown"] or run["broken"]) for run in well),
        "healthy_median_s": round(statistics.median(run["took_s"] for run in well), 2) if well else None,
        "booted_anew": reboots,
        "minutes": round((time.monotonic() - began) / 60.0, 1),
    }
    print(json.dumps(summary) if options.json else json.dumps(summary, indent=2))
    return 0 if not sick and all(result.right and result.healed is not False for result in (*singles, *combined)) else 1


def append_to_log(log: Path | None, what: dict[str, Any]) -> None:
    """Append a line of JSON, so that an interrupted run keeps its results."""
    if log is not None:
        with log.open("a") as file:
            file.write(json.dumps(what) + "\n")


def start_rig() -> Rig:
    """A booted and healthy robot."""
    rig = Rig.start()
    try:
        rig.until_healthy()
    except BaseException:
        rig.end()
        raise
    return rig


if __name__ == "__main__":
    sys.exit(main())
