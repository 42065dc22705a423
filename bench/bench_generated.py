"""How well `lupin doctor` diagnoses faults that no check knows by name, judged by what an operator's program really receives.

Each case is made on a booted robot and its laptop. Ground truth is measured (`bench/ground_truth.py`), then the doctor runs as
an operator runs it, and the case is undone. A diagnosis is right if it names the layers and machines that the case touches, and
nothing else; if it is never "healthy" while something is broken; and if it names nothing while all works.

With --log, each case appends one JSON line, and a later run continues behind the cases that the file already has. --fix also
plays the doctor's safe fixes: ground truth must not be worse afterwards, and what is marked healed must be healed. Needs
root, as the tests on booted hosts do.
"""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from bench.fault_rig import FaultRig, RigError
from bench.faults.fault import HOST, LAPTOP, LAYERS, Step
from bench.generated_cases import Case, Judgement, Truth, draw_case, draw_cases, fix_errors, judge, table_row_name
from bench.ground_truth import LIMIT_S
from bench.runner import Count, Figures, LimitS, Log, Seed, append_to_log, benchmark, note
from lupin_sim.host import HostError
from lupin_sim.host.fault_scripts import REMOVE_STALE_SEGMENTS
from lupin_sim.host.faults import parse_settings
from lupin_sim.host.host import PROJECT
from lupin_sim.host.rootfs import root_directory

NEVER = ("healthy_while_broken", "root_while_fine", "fix_errors", "errors", "late")  # counts that must be 0
BROKEN_LIMIT_S = 10.0  # within which the doctor must have diagnosed something that is broken
STEP_TIMEOUT_S = 90.0
RECOVERY_TIMEOUT_S = 90.0
CASE_ERRORS = (RigError, HostError, subprocess.TimeoutExpired)
# Services that were restarted are given this time to come up: what they do meanwhile is no fault.
BROKEN_SETTLE_S, HEALTHY_SETTLE_S = 15, 45
SETTLE = """
for second in $(seq {seconds}); do
  systemctl show -P ActiveState mirte-ros lupin-onboard | grep -qE '^(de)?activating' || exit 0
  sleep 1
done
"""
# The operator's laptop has the firewall's tool; this machine may not, so it is taken from the robot's root.
NFT_WRAPPER = '#!/bin/sh\nexec chroot {root} /usr/sbin/nft "$@"\n'


@dataclass
class Result:
    """One case of the log. `error` says why it could not be measured; it then counts for nothing."""

    seed: int
    number: int
    text: str
    row: str
    steps: tuple[tuple[str, str], ...] = ()  # where, and what was made
    truth: Truth | None = None
    judgement: Judgement | None = None
    fix_errors: tuple[str, ...] = ()
    said: tuple[str, ...] = ()  # cause of every root
    gaps: tuple[str, ...] = ()  # what the doctor could not examine
    status: int = -1
    took_s: float = 0.0  # of the doctor
    error: str = ""
    rebooted: str = ""  # why the rig had to be replaced afterwards
    cable_only: bool = False  # whether the rig had no access point


class Bench:
    """The rig, and how cases are made on it, observed and undone."""

    def __init__(self, *, cable_only: bool = False) -> None:
        self._cable_only = cable_only  # see FaultRig.start
        self.rig = self._boot()

    def _boot(self) -> FaultRig:
        rig = FaultRig.start(cable_only=self._cable_only)
        try:
            wrapper = rig.home / "bin" / "nft"
            wrapper.parent.mkdir()
            wrapper.write_text(NFT_WRAPPER.format(root=root_directory()))
            wrapper.chmod(0o755)
            rig.wait_until_healthy(env=self._shell(rig, {}))
        except BaseException:
            rig.stop()
            raise
        return rig

    def replace_rig(self) -> None:
        """Boot new machines."""
        self.rig.stop()
        self.rig = self._boot()

    def _shell(self, rig: FaultRig, variables: Mapping[str, str | None]) -> dict[str, str]:
        env: dict[str, str | None] = {**rig.sourced_env, "PATH": f"{rig.home}/bin:{rig.sourced_env['PATH']}", **variables}
        return {name: value for name, value in env.items() if value is not None}

    def make(self, step: Step) -> None:
        """Make one change. Raises RigError, HostError, TimeoutExpired."""
        if step.where == HOST:
            name, *assignments = step.make.split()
            self.rig.machines.robot.inject_fault(name, **parse_settings(name, assignments))
        else:
            self._run(step.where, step.make)

    def undo(self, step: Step) -> None:
        """Take one change back. Raises RigError, HostError, TimeoutExpired."""
        if step.where == HOST:
            name, *assignments = step.undo.split()
            self.rig.machines.robot.undo_fault(name, **parse_settings(name, assignments))
        else:
            self._run(step.where, step.undo)

    def _run(self, where: str, script: str) -> None:
        if where != LAPTOP:
            self.rig.run_as_root(script, STEP_TIMEOUT_S)
            return
        done = self.rig.machines.run(["sh", "-ec", script], timeout_s=STEP_TIMEOUT_S, env=self._shell(self.rig, {}))
        if done.returncode != 0:
            raise RigError(f"laptop: {script[:80]!r} exited with {done.returncode}: {done.stderr[-300:]}")

    def observe(self, variables: Mapping[str, str | None]) -> Truth:
        """Measure ground truth in the operator's shell. Raises RigError."""
        began = time.monotonic()
        env = self._shell(self.rig, variables)
        command = [sys.executable, "-m", "bench.ground_truth"]
        done = self.rig.machines.run(command, timeout_s=LIMIT_S + 60.0, env=env, cwd=str(PROJECT))
        try:
            broken = tuple(json.loads(done.stdout.splitlines()[-1])["broken"])
        except (ValueError, IndexError, KeyError):
            # A program that cannot even join is the operator's truth, too: another middleware, for example.
            broken = (f"a program cannot join the graph: {' '.join(done.stderr.split())[-200:]}",)
        return Truth(broken, self._can_log_in(), round(time.monotonic() - began, 2))

    def _can_log_in(self) -> bool:
        ssh = self.rig.home / ".ssh"
        options = ("BatchMode=yes", "ConnectTimeout=8", f"UserKnownHostsFile={ssh}/known_hosts", "IdentitiesOnly=yes")
        config = ssh / "config"
        command = ["ssh", "-F", str(config) if config.exists() else "none", "-i", str(ssh / "id_ed25519")]
        command += [word for option in options for word in ("-o", option)]
        try:
            return self.rig.machines.run([*command, "mirte@10.42.0.1", "true"], timeout_s=25.0).returncode == 0
        except subprocess.TimeoutExpired:
            return False

    def measure(self, case: Case, fix: bool) -> Result:
        """Make a case, observe, diagnose, undo; boot a new rig if this one does not recover."""
        steps = tuple((step.where, step.make) for step in case.steps)
        result = Result(case.seed, case.number, case.text, table_row_name(case), steps, cable_only=self._cable_only)
        made: list[Step] = []
        try:
            for step in case.steps:
                made.append(step)
                self.make(step)
            if any(fault.restarts for fault in case.faults):
                self.rig.run_as_root(SETTLE.format(seconds=BROKEN_SETTLE_S), STEP_TIMEOUT_S)
            self._diagnose(case, result, fix)
        except CASE_ERRORS as error:
            result.error = f"{type(error).__name__}: {error}"[:500]
        result.rebooted = self._recover(made)
        if result.rebooted:
            self.replace_rig()
        return result

    def _diagnose(self, case: Case, result: Result, fix: bool) -> None:
        env = self._shell(self.rig, case.variables)
        result.truth = self.observe(case.variables)
        report = self.rig.run_doctor(env=env)
        result.judgement = judge(case, result.truth, report)
        if not result.judgement.right and (again := self.observe(case.variables)).fine != result.truth.fine:
            # It changed meanwhile, because something restarted or hung: only a stable state can be judged.
            result.truth, report = again, self.rig.run_doctor(env=env)
            result.judgement = judge(case, again, report)
        result.status, result.took_s = report["status"], report["took_s"]
        result.said = tuple(f"{f['layer']}@{f['machine']} {f['severity']} {f['id']}: {f['cause']}" for f in report["findings"])
        result.gaps = (*report["unknown"], *report["broken"])
        if fix:
            after = self.rig.run_doctor("--fix", env=env)
            result.fix_errors = fix_errors(result.truth, self.observe(case.variables), after)

    def _recover(self, made: Sequence[Step]) -> str:
        """Undo all steps and wait until everything works again; return why it does not."""
        reason = ""
        for step in reversed(made):
            try:
                self.undo(step)
            except CASE_ERRORS as error:
                reason = reason or f"not undone: {error}"[:300]
        try:
            if made:
                self.rig.run_as_root(f"python3 - <<'END'\n{REMOVE_STALE_SEGMENTS}\nEND")
                self.rig.run_as_root(SETTLE.format(seconds=HEALTHY_SETTLE_S), STEP_TIMEOUT_S)
                self.rig.restore()
            deadline = time.monotonic() + RECOVERY_TIMEOUT_S
            while True:
                truth = self.observe({})
                report = self.rig.run_doctor(env=self._shell(self.rig, {})) if truth.fine and truth.login else None
                if report is not None and report["status"] == 0:
                    return reason
                if time.monotonic() > deadline:
                    remaining = truth.broken if report is None else [f"{f['id']}: {f['cause']}" for f in report["findings"]]
                    return reason or f"not healthy again: {'; '.join(remaining)}"[:500]
        except CASE_ERRORS as error:
            return reason or f"not healthy again: {error}"[:500]


@dataclass
class Row:
    """One row of the table: counts of measured cases."""

    cases: int = 0
    broken: int = 0
    root_right: int = 0
    machine_right: int = 0
    healthy_while_broken: int = 0
    root_while_fine: int = 0
    fix_errors: int = 0
    errors: int = 0
    slowest_s: float = 0.0  # of the diagnoses of something that was broken
    late: int = 0  # diagnoses of something broken that took longer than BROKEN_LIMIT_S

    def add(self, result: Result) -> None:
        """Count one result."""
        if result.judgement is None or result.truth is None:
            self.errors += 1
            return
        self.cases += 1
        self.broken += not result.truth.fine
        self.root_right += result.judgement.root_right
        self.machine_right += result.judgement.machine_right
        self.healthy_while_broken += result.judgement.healthy_while_broken
        self.root_while_fine += result.judgement.root_while_fine
        self.fix_errors += bool(result.fix_errors)
        if not result.truth.fine or not result.truth.login:
            self.slowest_s = max(self.slowest_s, result.took_s)
            self.late += result.took_s > BROKEN_LIMIT_S


def count_by_row(results: Sequence[Result]) -> dict[str, Row]:
    """Return the table's rows by layer, lowest first, then `harmless` and `all`."""
    rows = {name: Row() for name in (*LAYERS, "harmless", "all")}
    for result in results:
        rows[result.row].add(result)
        rows["all"].add(result)
    return {name: row for name, row in rows.items() if row.cases or row.errors or name == "all"}


def to_figures(rows: Mapping[str, Row], asked: int) -> Figures:
    """Return the table, and the shares of right roots and machines of all cases, of which `asked` should have been measured."""
    total = rows["all"]
    return {
        "layer": rows,
        "missing_cases": max(asked, 1) - total.cases,
        "root_right_share": total.root_right / max(total.cases, 1),
        "machine_right_share": total.machine_right / max(total.cases, 1),
    }


def format_result(result: Result) -> str:
    """Return one line about a case."""
    if result.judgement is None or result.truth is None:
        return f"NOT MEASURED {result.seed}/{result.number} {result.text}: {result.error}"
    mark = "ok   " if result.judgement.right and not result.fix_errors else "WRONG"
    state = "fine" if result.truth.fine else f"broken ({len(result.truth.broken)})"
    named = ",".join(result.judgement.named) or "-"
    line = f"{mark} {result.seed}/{result.number} {state:11} {named:24} {result.took_s:5.1f} s  {result.text}"
    return "; ".join([line, *result.fix_errors])


def load_log(log: Path | None, seed: int, *, cable_only: bool = False) -> list[Result]:
    """Return the results of an earlier run with this seed on the same kind of rig."""
    results = []
    for line in log.read_text().splitlines() if log is not None and log.exists() else ():
        entry = json.loads(line)
        if entry["seed"] == seed and entry.get("cable_only", False) == cable_only:
            truth, judgement = entry.pop("truth"), entry.pop("judgement")
            results.append(
                Result(
                    **entry,
                    truth=None if truth is None else Truth(**{**truth, "broken": tuple(truth["broken"])}),
                    judgement=None if judgement is None else Judgement(**judgement),
                )
            )
    return results


def run(bench: Bench, cases: Sequence[Case], fix: bool, limit_s: float, log: Path | None) -> list[Result]:
    """Measure the cases until the limit is over, and append each to the log."""
    deadline, results = time.monotonic() + limit_s, []
    for number, case in enumerate(cases):
        if time.monotonic() > deadline:
            note(f"--limit-s is over; not measured: {len(cases) - number} cases")
            break
        result = bench.measure(case, fix)
        results.append(result)
        note(format_result(result))
        if result.rebooted:
            note(f"  booted a new robot: {result.rebooted}")
        append_to_log(log, asdict(result))
    return results


@benchmark(
    at_most=dict.fromkeys((*(f"all.{name}" for name in NEVER), "missing_cases"), 0),
    at_least={"root_right_share": 0.95, "machine_right_share": 0.95},
    long=True,
)
def main(
    count: Count = 300,
    seed: Seed = 0,
    number: Annotated[tuple[int, ...], "only this case; may be repeated"] = (),
    only: Annotated[str, "only cases with a root at this layer", ("", *LAYERS)] = "",
    cable_only: Annotated[bool, "without the access point, over which DDS goes otherwise too"] = False,
    fix: Annotated[bool, "also play the safe fixes, and compare ground truth"] = False,
    log: Log = None,
    limit_s: LimitS = 3300.0,
    list_: Annotated[bool, "print the cases and their commands, and change nothing"] = False,
) -> Figures | None:
    """Measure the cases, and count them by layer."""
    cases = [draw_case(seed, each) for each in number] or list(itertools.islice(draw_cases(seed, only), count))
    if list_:
        for case in cases:
            print(f"{case.seed}/{case.number} {case.text}")
            for step in case.steps:
                print(f"  {step.where}: " + "\n    ".join(step.make.splitlines()))
        return None
    results = [result for result in load_log(log, seed, cable_only=cable_only) if not result.error]
    done = {result.number for result in results}
    missing = [case for case in cases if case.number not in done]
    results = [result for result in results if result.number in {case.number for case in cases}]
    if missing:
        bench = Bench(cable_only=cable_only)
        try:
            results += run(bench, missing, fix, limit_s, log)
        finally:
            bench.rig.stop()
    return to_figures(count_by_row(results), len(cases))


if __name__ == "__main__":
    sys.exit(main())
