"""One `lupin doctor` session: the laptop and at most one robot, examined and fixed over one connection."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from lupin_cli.checks import path as path_checks
from lupin_cli.checks.base import Check, Finding, Gap, Severity, Snapshot
from lupin_cli.checks.dds_environment import server_host
from lupin_cli.checks.ground_truth import State, measure
from lupin_cli.checks.packet_filter import SSH_PORT
from lupin_cli.checks.path_losses import loses_bursts
from lupin_cli.checks.stale_resources import AT_RISK, MEMORY_AT_RISK
from lupin_cli.connection.base import Target, TargetError
from lupin_cli.connection.destination import parse_destination
from lupin_cli.doctor.doubts import (
    answers_are_missing,
    is_lost_on_the_way,
    may_lose_packets,
    takes_too_long,
    unconfirmed_losses,
)
from lupin_cli.doctor.engine import STOPPED, Diagnosis, diagnose
from lupin_cli.doctor.fixes import FixResult, judge_fix, play_fix
from lupin_cli.doctor.gathering import gather_facts, gather_followup_facts, gather_snapshot, needed_facts
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.base import Facts
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.link import Link
from lupin_runtime.stack.dds import NoRobotEnvironment, robot_environment

if TYPE_CHECKING:
    from lupin_cli.connection.inventory import Config, Robot
    from lupin_cli.connection.ssh import SshTarget
    from lupin_cli.facts.clock import Offset
    from lupin_cli.link.path import Path
    from lupin_cli.link.quality import Ping

# A fix can reveal another cause. Three rounds are more than any pair of known faults needs.
MAX_FIX_ROUNDS = 3
MAX_PARALLEL_ROBOTS = 20
PATH_CHECKS = tuple(check.name for check in path_checks.CHECKS)
LATE_VISIT_S = 4.0  # a visit of a working robot takes about two; a lost discovery packet is sent again seconds later
# After a fix, a restarted stack may need this long until its topics deliver samples again.
AFTER_FIX_TIMEOUT_S = 30.0


@dataclass(frozen=True)
class DoctorScope:
    """What a session examines: the checks, the laptop, and the robot with its login."""

    checks: Sequence[Check]
    plugin_errors: Sequence[Gap]  # each plug-in that could not be loaded
    laptop: Target
    robot: Robot | None = None  # None examines the laptop alone
    config: Config | None = None
    sudo_password: str | None = None

    @property
    def name(self) -> str:
        """The robot's name, or "this machine"."""
        return self.robot.name if self.robot else "this machine"

    def addresses(self) -> list[str]:
        """Return the hosts under which the inventory knows the robot, best transport first."""
        if self.robot is None:
            return []
        hosts = self.hosts()
        return [hosts[self.robot.transport]] if self.robot.transport else list(hosts.values())

    def hosts(self) -> dict[str, str]:
        """Return all hosts under which the inventory knows the robot, also if one transport was chosen, by transport."""
        addresses = self.robot.addresses if self.robot is not None else {}
        return {transport: parse_destination(address)[1] for transport, address in addresses.items()}

    def best_transport(self) -> str:
        """Return the transport of the first of `addresses`; empty for an address that was typed."""
        return "" if self.robot is None else self.robot.transport or next(iter(self.robot.addresses), "")

    def login(self) -> str:
        """Return the command that logs in on the robot over its best transport; empty if that cannot be resolved."""
        from lupin_cli.connection.options import destinations

        with contextlib.suppress(TargetError):
            for each in destinations(self.robot).values() if self.robot else ():
                return each.login_command
        return ""


@dataclass(frozen=True)
class DoctorResult:
    """One examination: the facts, and what the checks found in them."""

    snapshot: Snapshot
    diagnosis: Diagnosis

    @property
    def link(self) -> Link | None:
        """How the robot was reached, or why not; None if no robot was selected."""
        return self.snapshot.link


class DoctorSession:
    """Examines what its scope names, and plays fixes, over one connection to the robot, which is kept until `close`."""

    def __init__(self, scope: DoctorScope, on_layer: Callable[[str], None] = lambda _: None) -> None:
        """Create a session. `on_layer` is called with the name of each layer of the path before it is measured."""
        self.scope = scope
        self._on_layer = on_layer
        self._target: SshTarget | None = None
        self._burst: Future[Ping | None] | None = None

    def examine(self, laptop_facts: Callable[[], Facts] | None = None, addresses: Sequence[str] = ()) -> DoctorResult:
        """Gather the facts of both machines and run the checks.

        If several sessions run together, `laptop_facts` waits for the laptop's facts, which they share, and `addresses` are
        those of all robots. Otherwise the session gathers the laptop's facts and uses its own robot's addresses.
        """
        scope, own_addresses = self.scope, self.scope.addresses()
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="burst") as pool:
            self._burst = pool.submit(self._ping_at_once)
            snapshot = gather_snapshot(
                scope.checks,
                scope.laptop,
                self._connect if scope.robot else None,
                self._link(own_addresses[0], scope.best_transport(), scope.login()) if scope.robot else None,
                addresses or own_addresses,
                self._clock_offset,
                laptop_facts,
                self._measure_path,
            )
        diagnosis = diagnose(scope.checks, snapshot, scope.plugin_errors)
        if snapshot.path is None and (
            is_lost_on_the_way(snapshot, diagnosis)
            or may_lose_packets(snapshot.link)
            or answers_are_missing(snapshot)
            # The next program that joins may not be as lucky.
            or measure(snapshot).visit_s > LATE_VISIT_S
            or (snapshot.link is not None and snapshot.link.reachable and loses_bursts(self._burst.result()))
        ):
            snapshot = replace(snapshot, path=self._measure_path(snapshot))
            diagnosis = diagnose(scope.checks, snapshot, scope.plugin_errors)
        if measure(snapshot).state is State.HEALTHY and any(finding.id == STOPPED for finding in diagnosis.findings):
            # One that is stopped again and again delivers in between: a second visit is unlikely to be as lucky.
            again = gather_facts(scope.laptop, "laptop", [GRAPH], addresses or own_addresses)
            snapshot = replace(snapshot, laptop=replace(snapshot.laptop, values={**snapshot.laptop.values, **again.values}))
            diagnosis = diagnose(scope.checks, snapshot, scope.plugin_errors)
        if any(finding.severity is Severity.PROBLEM for finding in diagnosis.by_check.get(path_checks.PACKETS, ())):
            return DoctorResult(snapshot, diagnosis)  # packets do not pass: a second visit of the graph would show the same
        roots = [root.finding for root in diagnosis.roots]
        if diagnosis.ground_truth is not None and diagnosis.ground_truth.needs_second_look:
            roots += unconfirmed_losses(diagnosis)
        with_followups = gather_followup_facts(
            scope.checks, diagnosis.by_check, roots, snapshot, scope.laptop, self._target, own_addresses
        )
        if with_followups is None:
            return DoctorResult(snapshot, diagnosis)
        return DoctorResult(with_followups, diagnose(scope.checks, with_followups, scope.plugin_errors))

    def _ping_at_once(self) -> Ping | None:
        """Ping the robot's address; None without one, if this user cannot, or if no check that needs it was selected."""
        addresses = self.scope.addresses()
        if not addresses or not addresses[0].replace(".", "").isdigit():
            return None
        if not any(check.name in PATH_CHECKS for check in self.scope.checks):
            return None
        from lupin_cli.link.quality import echo_burst

        return echo_burst(addresses[0])

    def _measure_path(self, snapshot: Snapshot) -> Path | None:
        """Measure the path to the robot's address that this shell's DDS uses; None if no check that needs it was selected."""
        if not any(check.name in PATH_CHECKS for check in self.scope.checks) or snapshot.link is None:
            return None
        from lupin_cli.link.path_measurement import measure_from

        address = self._dds_address(snapshot)
        if not address.replace(".", "").isdigit():
            return None
        robot = self._target if snapshot.link.reachable and not takes_too_long(snapshot) else None
        knocks = snapshot.link.kind == "timeout" or snapshot.link.unasked
        sshd = (snapshot.link.address, self._sshd_port()) if knocks else None
        path = measure_from(self.scope.laptop, robot, address, self._on_layer, sshd)
        if self._burst is None or address not in self.scope.addresses()[:1]:
            return path
        return replace(path, burst_ping=self._burst.result())

    def _sshd_port(self) -> int:
        from lupin_cli.connection.options import destinations

        with contextlib.suppress(TargetError):
            for each in destinations(self.scope.robot).values() if self.scope.robot else ():
                return each.port
        return SSH_PORT

    def _dds_address(self, snapshot: Snapshot) -> str:
        """Return the address of this shell's discovery server, if it is one of the robot's; else that of the connection."""
        assert snapshot.link is not None
        addresses = snapshot.robot_fact(ADDRESSES)
        known = {*self.scope.hosts().values(), *(each.address for each in (addresses.entries if addresses else ()))}
        server = os.environ.get("ROS_DISCOVERY_SERVER", "")
        if not server:
            with contextlib.suppress(NoRobotEnvironment):
                server = robot_environment()[0]["ROS_DISCOVERY_SERVER"]
        host = server_host(server)
        return host if host in known else snapshot.link.address

    def get_reachable_robot(self, result: DoctorResult) -> SshTarget | None:
        """Return the robot as a target; None if it did not answer for `result`, or none was selected."""
        return self._target if result.link is not None and result.link.reachable else None

    def apply_fixes(
        self,
        result: DoctorResult,
        accept: Callable[[Finding], bool],
        on_fix: Callable[[FixResult], None],
        *,
        dry_run: bool = False,
        rounds: int = MAX_FIX_ROUNDS,
    ) -> DoctorResult:
        """Play the playbooks of the root causes that `accept` allows, each once, and examine again after each round.

        `on_fix` is called after each playbook. Return the result of the last examination. A dry run plays one round and
        returns `result` unchanged.
        """
        played: set[tuple[str, str]] = set()
        for _ in range(rounds):
            accepted = []
            for root in result.diagnosis.roots:
                fix = root.finding.fix
                key = (fix.playbook, repr(sorted(fix.variables.items())))
                if fix.playbook and key not in played and accept(root.finding):
                    played.add(key)
                    accepted.append(root.finding)
            if not accepted:
                break
            for finding in accepted:
                on_fix(self.play_fix(finding, dry_run=dry_run))
            if dry_run:
                return result
            result = self.examine()
        return self._wait_for_samples(result) if played else result

    def _wait_for_samples(self, result: DoctorResult) -> DoctorResult:
        """Examine again while the ground truth is broken, for at most AFTER_FIX_TIMEOUT_S; return the last result."""
        deadline = time.monotonic() + AFTER_FIX_TIMEOUT_S
        while time.monotonic() < deadline:
            truth = result.diagnosis.ground_truth
            if truth is None or truth.state is not State.BROKEN:
                break
            result = self.examine()
        return result

    def find_endangered_memory(self, result: DoctorResult) -> Finding | None:
        """Return the finding that the end of this login takes the stack's shared memory away; None if it does not.

        Nothing that needs no root prevents it (measured with systemd 252): sshd opens a session of logind for every login, a
        user may not set its own lingering without polkit, and a process left in the session only postpones the cleanup to its
        own end. So it must be announced while the login lasts, also if its check was not selected.
        """
        found = next((each for each in result.diagnosis.findings if each.id == AT_RISK), None)
        robot = self.get_reachable_robot(result)
        if found is not None or robot is None or MEMORY_AT_RISK in self.scope.checks:
            return found
        try:
            facts = gather_facts(robot, "robot", MEMORY_AT_RISK.robot)
        except TargetError:
            return None
        snapshot = replace(result.snapshot, robot=facts)
        return next(iter(diagnose([MEMORY_AT_RISK], snapshot).findings), None)

    def play_fix(self, finding: Finding, *, dry_run: bool = False) -> FixResult:
        """Play the playbook of a finding, without asking."""
        targets: dict[str, Target] = {"laptop": self.scope.laptop}
        if self._target is not None:
            targets["robot"] = self._target
        return play_fix(finding, targets, dry_run=dry_run)

    def judge_fix(self, fix: FixResult, result: DoctorResult) -> FixResult:
        """Return a fix as the last examination shows it."""
        return judge_fix(fix, result.snapshot, result.diagnosis, self.scope.checks)

    def close(self) -> None:
        """Close the connection to the robot, if one was opened."""
        if self._target is not None:
            self._target.close()

    def _connect(self) -> tuple[Target, Link]:
        from lupin_cli.connection.options import open_target

        assert self.scope.robot is not None
        if self._target is None:
            self._target = open_target(self.scope.robot, self.scope.config, sudo_password=self.scope.sudo_password)
        transport = self._target.connect()
        peer = ""
        # Behind a jump host, the transport has no socket.
        with contextlib.suppress(OSError, AttributeError, IndexError, TypeError):
            peer = str(transport.getpeername()[0])
        address = peer or self._target.destination.host
        transport_name, login = self._target.transport_name, self._target.login_command
        return self._target, self._link(address, transport_name, login)

    def _link(self, address: str, transport: str, login: str) -> Link:
        return Link(self.scope.name, address, transport=transport, login=login, addresses=self.scope.hosts())

    def _clock_offset(self) -> Offset | None:
        """Return the offset of the robot's clock at the start of the last batch; None without a readable answer."""
        from lupin_cli.link.clock_offset import ClockError, Sample, estimate, parse_epoch

        reading = None if self._target is None else self._target.clock_reading
        if reading is None:
            return None
        try:
            return estimate([Sample(reading.sent_ns, parse_epoch(reading.text), reading.received_ns)]).offset
        except ClockError:
            return None  # checks fall back on the fact `clock`


def examine_all(
    sessions: Sequence[DoctorSession], on_result: Callable[[DoctorSession, DoctorResult], None] = lambda *_: None
) -> list[DoctorResult]:
    """Examine several robots at the same time.

    The laptop's first facts are gathered once for all robots, its follow-up facts once per robot. `on_result` is called as each
    examination ends, even if another one raises.
    """
    scope = sessions[0].scope
    addresses = [address for session in sessions for address in session.scope.addresses()]

    def examine(session: DoctorSession) -> DoctorResult:
        result = session.examine(laptop_facts, addresses)
        on_result(session, result)
        return result

    if len(sessions) == 1:
        laptop_facts: Callable[[], Facts] | None = None
        return [examine(sessions[0])]
    with ThreadPoolExecutor(max_workers=MAX_PARALLEL_ROBOTS + 1, thread_name_prefix="doctor") as pool:
        pending = pool.submit(gather_facts, scope.laptop, "laptop", needed_facts(scope.checks, "laptop"), addresses)
        laptop_facts = pending.result
        return list(pool.map(examine, sessions))
