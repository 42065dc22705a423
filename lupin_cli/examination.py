"""An examination: who is asked and over which connection, what is found, what is mended, and how things stand after that."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import field
from typing import TYPE_CHECKING, Any

from lupin_cli.checks.base import Check, Evidence, Finding
from lupin_cli.diagnosis import Diagnosis, ask, diagnose, facts_of, gather, look_closer
from lupin_cli.facts.base import Facts
from lupin_cli.facts.link import Link
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target

if TYPE_CHECKING:
    from lupin_cli.config import Config, Robot
    from lupin_cli.facts.clock import Offset
    from lupin_cli.robot_options import Way
    from lupin_cli.runbook import Event
    from lupin_cli.target.ssh import SshTarget

# A mended cause can uncover another; three rounds are more than any pair of known faults needs.
ROUNDS = 3
AT_ONCE = 20
HEAD_START_S = 0.5  # of the ways to several robots, before this machine is asked


@dataclass(frozen=True)
class Treatment:
    """What was played for a finding, and what came of it."""

    finding: str
    playbook: str
    state: str  # done, failed, declined, unreachable, interrupted, refused
    changed: int = 0
    message: str = ""
    dry_run: bool = False
    lines: tuple[str, ...] = ()


def examine_all(examinations: Sequence[Examination]) -> None:
    """Examine several robots side by side; this machine is asked once for all of them, while they think: before that its shells
    would take the processor from the ways there."""
    first = examinations[0]
    addresses = [address for each in examinations for address in each.addresses()]
    ways = [each.way for each in examinations if each.way is not None]

    def ask_here() -> Facts:
        deadline = time.monotonic() + HEAD_START_S
        for way in ways:
            way.settle(deadline - time.monotonic())
        return ask(first.laptop, "laptop", facts_of(first.checks, "laptop"), addresses)

    with ThreadPoolExecutor(max_workers=AT_ONCE + 1, thread_name_prefix="doctor") as pool:
        here = pool.submit(ask_here)
        list(pool.map(lambda each: each.examine(here.result, addresses), examinations))


@dataclass
class Examination:
    """This machine and at most one robot, over one connection that is kept until `close`."""

    checks: Sequence[Check]
    broken: Sequence[str]
    laptop: Target
    robot: Robot | None = None
    config: Config | None = None
    sudo_password: str | None = None
    way: Way | None = field(default=None, repr=False)  # where somebody has set out for the robot already
    link: Link | None = None
    diagnosis: Diagnosis | None = None
    evidence: Evidence | None = None
    connections: int = 0
    _target: SshTarget | None = field(default=None, repr=False)
    _transport: Any = field(default=None, repr=False)

    def examine(self, told: Callable[[], Facts] | None = None, addresses: Sequence[str] = ()) -> Diagnosis:
        """Ask both ends and judge what they say. `told` and `addresses` are what several examinations together have of this
        machine, and the addresses of all of their robots."""
        own = self.addresses()
        link = Link(self.robot.name, own[0]) if self.robot else None
        reach = self._reach if self.robot else None
        evidence = gather(self.checks, self.laptop, reach, link, addresses or own, self._clock_offset, told)
        self.evidence, self.link = evidence, evidence.link
        self.diagnosis = diagnose(self.checks, evidence, self.broken)
        closer = look_closer(self.checks, self.diagnosis, evidence, self.laptop, self._target, own)
        if closer is not None:
            self.evidence = closer
            self.diagnosis = diagnose(self.checks, closer, self.broken)
        return self.diagnosis

    @property
    def reached(self) -> Target | None:
        """The robot, over the connection of the last examination; None where it did not answer or none was asked for."""
        return self._target if self.link is not None and self.link.reachable else None

    def addresses(self) -> list[str]:
        """The hosts under which the inventory knows the robot, best transport first."""
        if self.robot is None:
            return []
        from lupin_cli.target.destination import parse_destination

        wanted = [self.robot.transport] if self.robot.transport else list(self.robot.addresses)
        return [parse_destination(self.robot.addresses[transport])[1] for transport in wanted]

    def _reach(self) -> tuple[Target, Link]:
        from lupin_cli.robot_options import open_target

        assert self.robot is not None
        way, self.way = self.way, None
        if way is not None:
            self._target = way.target()
            way.wait()
        if self._target is None:
            self._target = open_target(self.robot, self.config, sudo_password=self.sudo_password, at_once=True)
        transport = self._target.connect()
        self.connections += transport is not self._transport
        self._transport = transport
        self._target.get_ready()
        peer = ""
        with contextlib.suppress(OSError, AttributeError, IndexError, TypeError):  # behind a jump there is no socket of ours
            peer = str(transport.getpeername()[0])
        return self._target, Link(self.robot.name, peer or self._target.destination.host)

    def _clock_offset(self) -> Offset | None:
        """The robot's clock against this machine's, as the batch began; None where it said nothing that can be read."""
        from lupin_cli.clock import ClockError, Sample, estimate, read_answer

        reading = None if self._target is None else self._target.clock_reading
        if reading is None:
            return None
        try:
            return estimate([Sample(reading.sent_ns, read_answer(reading.said), reading.heard_ns)]).offset
        except ClockError:
            return None  # the probes' own reading remains

    def treatments(
        self, accept: Callable[[Finding], bool], *, dry_run: bool = False, rounds: int = ROUNDS
    ) -> Iterator[Treatment]:
        """Play the playbooks of the causes that `accept` lets pass, and look again; each is played once.

        `diagnosis` and `link` tell the state after the last one.
        """
        played: set[tuple[str, str]] = set()
        for _ in range(rounds):
            assert self.diagnosis is not None
            due = []
            for root in self.diagnosis.roots:
                fix = root.finding.fix
                key = (fix.playbook, repr(sorted(fix.variables.items())))
                if fix.playbook and key not in played and accept(root.finding):
                    played.add(key)
                    due.append(root.finding)
            if not due:
                return
            for finding in due:
                yield self._treat(finding, dry_run)
            if dry_run:
                return
            self.examine()

    def _treat(self, finding: Finding, dry_run: bool) -> Treatment:
        from lupin_cli.runbook import JournalError, PlaybookError, play

        lines: list[str] = []

        def note(event: Event) -> None:
            if event.kind in ("step-end", "difference") and event.text:
                lines.append(f"{event.step}: {event.text}" if event.step else event.text)

        targets: dict[str, Target] = {"laptop": self.laptop}
        if self._target is not None:
            targets["robot"] = self._target
        try:
            result = play(
                finding.fix.playbook,
                targets,
                finding.fix.variables,
                dry_run=dry_run,
                confirm=_already_asked,
                on_event=note,
            )
        except (FileNotFoundError, PlaybookError, JournalError) as error:
            return Treatment(finding.id, finding.fix.playbook, "refused", message=str(error), dry_run=dry_run)
        return Treatment(finding.id, finding.fix.playbook, result.state, result.changed, result.message, dry_run, tuple(lines))

    def close(self) -> None:
        """Let the connection go, also one that is still being opened."""
        if self.way is not None:
            self.way.forget()
        if self._target is not None:
            self._target.close()


def _already_asked(question: str) -> bool:
    """A treatment is only begun with a person's or the finding's leave."""
    return True


def treatment_dict(treatment: Treatment) -> dict[str, Any]:
    """A treatment as JSON-able data."""
    return {
        "finding": treatment.finding,
        "playbook": treatment.playbook,
        "state": treatment.state,
        "changed": treatment.changed,
        "message": treatment.message,
        "dry_run": treatment.dry_run,
    }
