"""One `lupin doctor` session: the laptop and at most one robot, examined and fixed over one connection."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.connection.base import Target
from lupin_cli.doctor.engine import Diagnosis, diagnose
from lupin_cli.doctor.gathering import gather_facts, gather_followup_facts, gather_snapshot, needed_facts
from lupin_cli.facts.base import Facts
from lupin_cli.facts.link import Link

if TYPE_CHECKING:
    from lupin_cli.connection.inventory import Config, Robot
    from lupin_cli.connection.ssh import SshTarget
    from lupin_cli.facts.clock import Offset
    from lupin_cli.playbook import Event

# A fix can reveal another cause. Three rounds are more than any pair of known faults needs.
MAX_FIX_ROUNDS = 3
MAX_PARALLEL_ROBOTS = 20


@dataclass(frozen=True)
class DoctorScope:
    """What a session examines: the checks, the laptop, and the robot with its login."""

    checks: Sequence[Check]
    plugin_errors: Sequence[str]  # one line for each plug-in that could not be loaded
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
        from lupin_cli.connection.destination import parse_destination

        transports = [self.robot.transport] if self.robot.transport else list(self.robot.addresses)
        return [parse_destination(self.robot.addresses[transport])[1] for transport in transports]


@dataclass(frozen=True)
class DoctorResult:
    """One examination: the facts, and what the checks found in them."""

    snapshot: Snapshot
    diagnosis: Diagnosis

    @property
    def link(self) -> Link | None:
        """How the robot was reached, or why not; None if no robot was selected."""
        return self.snapshot.link


@dataclass(frozen=True)
class FixResult:
    """A playbook that was played for a finding, and how it ended."""

    finding: str
    playbook: str
    state: str  # done, failed, declined, unreachable, interrupted, refused
    changed: int = 0
    message: str = ""
    dry_run: bool = False
    changes: tuple[str, ...] = ()  # what each step changed, or would change

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON-able data."""
        return {
            "finding": self.finding,
            "playbook": self.playbook,
            "state": self.state,
            "changed": self.changed,
            "message": self.message,
            "dry_run": self.dry_run,
        }


class DoctorSession:
    """Examines what its scope names, and plays fixes, over one connection to the robot, which is kept until `close`."""

    def __init__(self, scope: DoctorScope) -> None:
        self.scope = scope
        self._target: SshTarget | None = None

    def examine(self, laptop_facts: Callable[[], Facts] | None = None, addresses: Sequence[str] = ()) -> DoctorResult:
        """Gather the facts of both machines and run the checks.

        If several sessions run together, `laptop_facts` waits for the laptop's facts, which they share, and `addresses` are
        those of all robots. Otherwise the session gathers the laptop's facts and uses its own robot's addresses.
        """
        scope, own_addresses = self.scope, self.scope.addresses()
        snapshot = gather_snapshot(
            scope.checks,
            scope.laptop,
            self._connect if scope.robot else None,
            Link(scope.robot.name, own_addresses[0]) if scope.robot else None,
            addresses or own_addresses,
            self._clock_offset,
            laptop_facts,
        )
        diagnosis = diagnose(scope.checks, snapshot, scope.plugin_errors)
        with_followups = gather_followup_facts(
            scope.checks, diagnosis.by_check, snapshot, scope.laptop, self._target, own_addresses
        )
        if with_followups is None:
            return DoctorResult(snapshot, diagnosis)
        return DoctorResult(with_followups, diagnose(scope.checks, with_followups, scope.plugin_errors))

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
                return result
            for finding in accepted:
                on_fix(self._play_fix(finding, dry_run))
            if dry_run:
                return result
            result = self.examine()
        return result

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
        return self._target, Link(self.scope.robot.name, peer or self._target.destination.host)

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

    def _play_fix(self, finding: Finding, dry_run: bool) -> FixResult:
        from lupin_cli.playbook import JournalError, PlaybookError, play

        fix, changes = finding.fix, []

        def note_change(event: Event) -> None:
            if event.kind in ("step-end", "difference") and event.text:
                changes.append(f"{event.step}: {event.text}" if event.step else event.text)

        targets: dict[str, Target] = {"laptop": self.scope.laptop}
        if self._target is not None:
            targets["robot"] = self._target
        try:
            played = play(fix.playbook, targets, fix.variables, dry_run=dry_run, confirm=_confirm_always, on_event=note_change)
        except (FileNotFoundError, PlaybookError, JournalError) as error:
            return FixResult(finding.id, fix.playbook, "refused", message=str(error), dry_run=dry_run)
        return FixResult(finding.id, fix.playbook, played.state, played.changed, played.message, dry_run, tuple(changes))


def _confirm_always(_question: str) -> bool:
    """Answer a playbook's question with yes: `accept` has already allowed the fix."""
    return True


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
