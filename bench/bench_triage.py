"""The triage tree against a robot that boots: every fault alone, then in pairs, then nothing at all many times.

A fault counts as named where the doctor calls it by its name as a cause of its own, or folds it under the other of a pair;
false is every cause that is not there. What a finding marks safe is then healed by `--fix` alone, and counts as healed where
the doctor finds nothing afterwards. With --yes, cures that need a person's leave are played too.

    python -m bench.bench_triage [--only PATTERN] [--pairs N | --together N] [--healthy N]
                                   [--seed N] [--yes] [--log FILE] [--json]

Needs root, as the host's tests do. Everything is against one booted host; it is booted anew where it does not get well.
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

from bench.rig import Rig, RigError
from bench.triage import CASES, Case
from lupin_sim.host import HostError

# A restart of the stack, which some faults need, cleans up what others leave behind; a full disk is in everybody's way.
LATE = {"leftovers": 1, "software": 2, "disk": 3}
REPEATED_S = 10.0  # a fault may need its time to show: a lease of DDS, a poll of chrony


@dataclass
class Outcome:
    """What came of one fault, or of two at once."""

    faults: tuple[str, ...]
    expected: tuple[str, ...]
    named: tuple[str, ...] = ()  # as causes
    folded: tuple[str, ...] = ()  # as consequences
    missed: tuple[str, ...] = ()
    false: tuple[str, ...] = ()
    looks: int = 0  # diagnoses until it was named
    took_s: float = 0.0
    healed: bool | None = None  # by --fix; None where nothing was marked safe
    left: tuple[str, ...] = ()  # causes after --fix
    played: tuple[str, ...] = ()
    error: str = ""
    lines: tuple[str, ...] = field(default=(), repr=False)  # causes of what was false or left

    @property
    def right(self) -> bool:
        """Whether all of it was named and nothing else."""
        return not (self.missed or self.false or self.error)


def judge(outcome: Outcome, told: dict[str, Any]) -> None:
    """Fill in what a diagnosis says of the expected causes."""
    causes = [finding["id"] for finding in told["findings"]]
    folded = [finding["id"] for root in told["findings"] for finding in root["consequences"]]
    wanted = set(outcome.expected)
    outcome.named = tuple(sorted(wanted & set(causes)))
    outcome.folded = tuple(sorted((wanted & set(folded)) - set(causes)))
    outcome.missed = tuple(sorted(wanted - set(causes) - set(folded)))
    outcome.false = tuple(sorted(set(causes) - wanted))
    gaps = [*told["unknown"], *told["broken"]] if told["status"] != 3 else told["broken"]
    outcome.error = "; ".join(gaps)
    outcome.took_s = told["took_s"]
    outcome.lines = tuple(f"{f['id']}: {f['cause']} | {' | '.join(f['evidence'][:4])}" for f in told["findings"])


def look(rig: Rig, cases: Sequence[Case], outcome: Outcome) -> dict[str, Any]:
    """Ask the doctor, and once more while something is missed, since a fault may need its time to show."""
    shell = next((case.shell for case in cases if case.shell != "sourced"), "sourced")
    deadline = time.monotonic() + REPEATED_S
    while True:
        outcome.looks += 1
        told = rig.doctor(env=rig.shells[shell], robot=cases[0].robot)
        judge(outcome, told)
        if not outcome.missed or time.monotonic() > deadline:
            return told


def heal(rig: Rig, cases: Sequence[Case], outcome: Outcome, told: dict[str, Any], yes: bool) -> None:
    """Let --fix do what it may, and see what is left."""
    due = [finding for finding in told["findings"] if finding["fix"]["playbook"] and (yes or finding["fix"]["safe"])]
    if not due:
        return
    shell = next((case.shell for case in cases if case.shell != "sourced"), "sourced")
    words = ["--fix", *(["--yes"] if yes else [])]
    after = rig.doctor(*words, env=rig.shells[shell], robot=cases[0].robot)
    seen = {finding["id"] for root in told["findings"] for finding in (root, *root["consequences"])}
    unasked = seen - {finding["id"] for finding in due}
    outcome.played = tuple(f"{t['playbook']}: {t['state']}" for t in after["treatments"])
    outcome.left = tuple(sorted({finding["id"] for finding in after["findings"]} - unasked))
    outcome.healed = not outcome.left and not after["unknown"] and not after["broken"]
    if not outcome.healed:
        outcome.lines += tuple(f"left {f['id']}: {f['cause']} | {' | '.join(f['evidence'][:4])}" for f in after["findings"])


def attempt(rig: Rig, cases: Sequence[Case], yes: bool) -> tuple[Outcome, str]:
    """Make the faults, ask, heal, take them back, and wait for health. Returns why the rig can't go on, or nothing."""
    expected = tuple(sorted(frozenset().union(*(case.expected for case in cases))))
    outcome = Outcome(tuple(case.name for case in cases), expected)
    broken, made = "", []
    try:
        for case in sorted(cases, key=lambda case: LATE.get(case.area, 0)):
            made.append(case)
            case.make(rig)
        heal(rig, cases, outcome, look(rig, cases, outcome), yes)
    except (RigError, HostError, subprocess.TimeoutExpired) as error:
        outcome.error = f"{type(error).__name__}: {error}"[:400]
    for case in reversed(made):
        try:
            case.mend(rig)
        except (RigError, HostError, subprocess.TimeoutExpired) as error:
            broken = broken or f"{case.name} could not be taken back: {error}"[:300]
    try:
        rig.restore()
        rig.until_healthy()
    except (RigError, HostError, subprocess.TimeoutExpired) as error:
        broken = f"after {' and '.join(outcome.faults)}: {broken or error}"[:600]
    return outcome, broken


def fitting(cases: Sequence[Case]) -> list[tuple[Case, Case]]:
    """The pairs that can stand together."""
    return [pair for pair in combinations(cases, 2) if pair[0].fits(pair[1])]


def names(pair: tuple[Case, Case]) -> tuple[str, ...]:
    """A pair by its names, in one order whoever comes first."""
    return tuple(sorted(case.name for case in pair))


def groups_of(cases: Sequence[Case], size: int, seed: int, known: Collection[tuple[str, ...]] = ()) -> list[tuple[Case, ...]]:
    """Sets of up to `size` faults that can all stand together, until every pair that can, and isn't `known`, is in one.

    A fault that hides another in a pair hides it among more, so that a set in which all are named speaks for each of its pairs.
    """
    place = {case.name: index for index, case in enumerate(cases)}
    left = {(place[one.name], place[other.name]) for one, other in fitting(cases) if names((one, other)) not in known}
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


def known_from(log: Path | None, cases: Sequence[Case]) -> set[tuple[str, ...]]:
    """The pairs that an earlier run's log speaks for."""
    pairs: set[tuple[str, ...]] = set()
    for text in log.read_text().splitlines() if log is not None and log.exists() else ():
        told = json.loads(text)
        if "faults" in told:
            outcome = Outcome(**{each.name: told[each.name] for each in fields(Outcome) if each.name in told})
            pairs |= proven(outcome, [case for case in cases if case.name in outcome.faults])
    return pairs


def proven(outcome: Outcome, cases: Sequence[Case]) -> set[tuple[str, ...]]:
    """The pairs for which an outcome speaks: both were told, and nothing that is not there."""
    if outcome.false or outcome.error:
        return set()
    told = {*outcome.named, *outcome.folded}
    return set(map(names, fitting([case for case in cases if case.expected <= told])))


def healthy_runs(rig: Rig, count: int, beside: int, note: Callable[[dict[str, Any]], object]) -> list[dict[str, Any]]:
    """As many diagnoses of a robot that is well, some of them at the same time; `note` hears of each as it ends."""
    rig.until_healthy()
    told = []
    with ThreadPoolExecutor(max_workers=beside) as pool:
        for run in as_completed([pool.submit(rig.doctor) for _ in range(count)]):
            told.append(run.result())
            note(told[-1])
    return told


def line(outcome: Outcome) -> str:
    """One line of the matrix."""
    mark = "ok" if outcome.right else "WRONG"
    words = [f"{mark:6}{' + '.join(outcome.faults):58}  {','.join(outcome.named) or '-'}"]
    for label, value in (("folded", outcome.folded), ("missed", outcome.missed), ("false", outcome.false)):
        if value:
            words.append(f"{label} {','.join(value)}")
    if outcome.healed is not None:
        words.append("healed" if outcome.healed else f"NOT HEALED: {','.join(outcome.left)} ({'; '.join(outcome.played)})")
    if outcome.error:
        words.append(f"error {outcome.error}")
    return "  ".join([*words, f"{outcome.looks}x {outcome.took_s:.1f} s"])


def score(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Counts over several outcomes."""
    cured = [outcome for outcome in outcomes if outcome.healed is not None]
    return {
        "runs": len(outcomes),
        "right": sum(outcome.right for outcome in outcomes),
        "causes": sum(len(outcome.expected) for outcome in outcomes),
        "named": sum(len(outcome.named) for outcome in outcomes),
        "folded": sum(len(outcome.folded) for outcome in outcomes),
        "missed": sum(len(outcome.missed) for outcome in outcomes),
        "false": sum(len(outcome.false) for outcome in outcomes),
        "errors": sum(bool(outcome.error) for outcome in outcomes),
        "safe": len(cured),
        "healed": sum(bool(outcome.healed) for outcome in cured),
    }


def main() -> int:
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
    parser.add_argument("--log", type=Path, help="every outcome as a line of JSON; pairs that it proves already are in no set")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    began = time.monotonic()
    chosen = [case for case in CASES if not options.only or any(fnmatch.fnmatch(case.name, only) for only in options.only)]
    possible = fitting(chosen)
    pairs = random.Random(options.seed).sample(possible, min(options.pairs, len(possible)))
    seen = known_from(options.log, chosen)
    groups = groups_of(chosen, options.together, options.seed, seen) if options.together else []
    plan: list[tuple[Case, ...]] = [*([] if options.no_singles else [(case,) for case in chosen]), *pairs, *groups]
    singles: list[Outcome] = []
    doubles: list[Outcome] = []
    well: list[dict[str, Any]] = []
    told, reboots = sys.stderr if options.json else sys.stdout, 0
    rig = ready()
    try:
        for cases in plan:
            if time.monotonic() - began > options.limit_s:
                print(f"out of time: {len(plan) - len(singles) - len(doubles)} left", file=told, flush=True)
                break
            outcome, broken = attempt(rig, cases, options.yes)
            (singles if len(cases) == 1 else doubles).append(outcome)
            seen |= proven(outcome, cases)
            print(line(outcome), file=told, flush=True)
            note(options.log, asdict(outcome) | {"broken": broken})
            if broken:
                print(f"  booted anew: {broken}", file=told, flush=True)
                reboots += 1
                rig.end()
                rig = ready()
        if options.healthy:
            well = healthy_runs(rig, options.healthy, options.beside, lambda run: note(options.log, run))
    finally:
        rig.end()
    sick = [run for run in well if run["status"] != 0]
    for run in sick:
        print(f"healthy, and told {run['status']}: {run['findings']} {run['unknown']} {run['broken']}", file=told)
    result = {
        "faults": len(chosen),
        "alone": score(singles),
        "pairs_possible": len(possible),
        "pairs_right": len(seen),
        "together": score(doubles),
        "healthy_runs": len(well),
        "healthy_with_findings": sum(bool(run["findings"]) for run in well),
        "healthy_not_fully_seen": sum(bool(run["unknown"] or run["broken"]) for run in well),
        "healthy_median_s": round(statistics.median(run["took_s"] for run in well), 2) if well else None,
        "booted_anew": reboots,
        "minutes": round((time.monotonic() - began) / 60.0, 1),
    }
    print(json.dumps(result) if options.json else json.dumps(result, indent=2))
    return 0 if not sick and all(outcome.right and outcome.healed is not False for outcome in (*singles, *doubles)) else 1


def note(log: Path | None, what: dict[str, Any]) -> None:
    """Write a line of JSON, so that a run that is cut off has told what it saw."""
    if log is not None:
        with log.open("a") as file:
            file.write(json.dumps(what) + "\n")


def ready() -> Rig:
    """A robot that is up and well."""
    rig = Rig.start()
    try:
        rig.until_healthy()
    except BaseException:
        rig.end()
        raise
    return rig


if __name__ == "__main__":
    sys.exit(main())
