"""All that an archive could hold, asked of this machine and of robots: each over the one connection of its examination."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from lupin_cli.bundle import asking, plain, sources
from lupin_cli.bundle.pieces import ABSENT, FAILED, UNREACHABLE, LeftOut, Piece
from lupin_cli.checks.base import Check
from lupin_cli.config import Config, Robot
from lupin_cli.diagnosis import Diagnosis
from lupin_cli.examination import AT_ONCE, Examination, examine_all
from lupin_cli.facts.base import Facts, Unknown
from lupin_cli.facts.link import Link
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.report import to_dict, to_markdown
from lupin_cli.target.base import Target

Found = Piece | LeftOut
Tell = Callable[[str], None]


@dataclass
class Gathering:
    """What is asked, and of whom. Close it at the end."""

    checks: Sequence[Check]
    broken: Sequence[str]
    laptop: Target
    robots: Sequence[Robot] = ()
    config: Config | None = None
    sudo_passwords: dict[str, str] | None = None  # by robot
    since_s: float | None = None

    def __post_init__(self) -> None:
        passwords = self.sudo_passwords or {}
        self.examinations = [
            Examination(self.checks, self.broken, self.laptop, robot, self.config, passwords.get(robot.name))
            for robot in self.robots
        ] or [Examination(self.checks, self.broken, self.laptop)]

    def __call__(self, tell: Tell) -> list[Found]:
        """Ask, in the order in which an archive is read. `tell` hears what is being done."""
        who = " and ".join(["this machine", *(robot.name for robot in self.robots)])
        tell(f"asking {who} what the doctor asks ...")
        found = list(self._diagnoses())
        tell(f"reading journals and settings of {who} ...")
        with ThreadPoolExecutor(max_workers=AT_ONCE, thread_name_prefix="bundle") as pool:
            try:
                here = pool.submit(self._of_laptop)
                there = list(pool.map(self._of_robot, self.examinations))
                return [*found, *here.result(), *(each for of_robot in there for each in of_robot)]
            except BaseException:  # an interrupt, say: nobody waits for robots then
                self.close()
                raise

    @property
    def links(self) -> list[Link]:
        """How each robot was reached, or why not."""
        return [
            each.link or Link(each.robot.name, "", "target", "it was never tried")
            for each in self.examinations
            if each.robot is not None
        ]

    @property
    def secrets(self) -> list[str]:
        """The passwords that were typed for robots."""
        typed = list((self.sudo_passwords or {}).values())
        return typed + [secret for each in self.examinations for secret in getattr(each.reached, "secrets", ())]

    def close(self) -> None:
        """Let the connections go."""
        for examination in self.examinations:
            examination.close()

    # -- the doctor's part

    def _diagnoses(self) -> Iterator[Found]:
        try:
            if len(self.examinations) == 1:
                self.examinations[0].examine()
            else:
                examine_all(self.examinations)
        except (
            Exception
        ) as error:  # a doctor that is ill itself must not keep the logs that tell why from those who could read them
            yield LeftOut("findings", FAILED, f"the doctor failed: {type(error).__name__}: {error}")
        for examination in self.examinations:
            name = examination.robot.name if examination.robot else "laptop"
            if examination.diagnosis is not None:
                yield from _findings(name, examination.diagnosis, examination.link)
        evidence = next((each.evidence for each in self.examinations if each.evidence is not None), None)
        if evidence is not None:
            yield from facts_of("laptop", evidence.laptop)
        for examination in self.examinations:
            if examination.evidence is not None and examination.evidence.robot is not None and examination.robot is not None:
                yield from facts_of(f"robots/{examination.robot.name}", examination.evidence.robot)

    # -- the rest

    def _of_laptop(self) -> list[Found]:
        of_laptop = sources.of_machine(sources.LAPTOP)
        return list(asking.ask(self.laptop, of_laptop, "laptop", since_s=self.since_s, sudo=False))

    def _of_robot(self, examination: Examination) -> list[Found]:
        if examination.robot is None:
            return []
        folder = f"robots/{examination.robot.name}"
        link = examination.link
        found: list[Found] = [Piece(f"{folder}/link.json", "how it was reached, or why not", plain.plain(link))]
        if examination.reached is None:
            reason = link.message if link else "it was never tried"
            return [*found, LeftOut(folder, UNREACHABLE, reason)]
        of_robot = sources.of_machine(sources.ROBOT)
        return [*found, *asking.ask(examination.reached, of_robot, folder, since_s=self.since_s)]


def _findings(name: str, diagnosis: Diagnosis, link: Link | None) -> Iterator[Piece]:
    told = to_markdown(diagnosis, f"Diagnosis of {name}").encode("utf-8", "surrogateescape")
    yield Piece(f"findings/{name}.md", "what the doctor found, to read", told)
    yield Piece(f"findings/{name}.json", "what the doctor found", to_dict(diagnosis, link))


def facts_of(folder: str, facts: Facts) -> Iterable[Found]:
    """The facts of a machine as they were understood, and each probe's words beside them, so that a parser's fault shows."""
    yield Piece(f"{folder}/facts.json", "the facts as they were understood", plain.facts(facts))
    table: dict[str, Any] = {}
    for name, output in sorted(facts.outputs.items()):
        table[name] = {
            "status": output.status,
            "duration_s": round(output.duration_s, 3),
            "truncated": output.truncated,
            "stderr": output.stderr,
            "unknown": value.reason if isinstance(value := facts.values.get(name), Unknown) else None,
        }
        place = f"{folder}/probes/{name}.out"
        if output.stdout.strip():
            yield Piece(place, f"what the probe {name} printed", output.stdout.encode("utf-8", "surrogateescape"))
        else:
            yield LeftOut(place, ABSENT, f"the probe printed nothing: {output.stderr.strip() or f'status {output.status}'}")
    yield Piece(f"{folder}/probes/index.json", "how each probe ended", json.loads(json.dumps(table)))
