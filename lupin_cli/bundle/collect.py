"""Collects the items of an archive: findings, facts, logs and settings of every machine, and Lupin's own files on this one."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lupin_cli import __version__
from lupin_cli.bundle.items import ABSENT, FAILED, TOO_BIG, UNREACHABLE, UNREADABLE, BundleItem, Omission, encode, truncate_file
from lupin_cli.bundle.sources import LAPTOP, ROBOT, read_sources, sources_of
from lupin_cli.checks.base import Check, Gap
from lupin_cli.connection.base import Target
from lupin_cli.connection.inventory import Config, Robot
from lupin_cli.doctor.engine import Diagnosis
from lupin_cli.doctor.report import to_dict, to_markdown
from lupin_cli.doctor.session import MAX_PARALLEL_ROBOTS, DoctorResult, DoctorScope, DoctorSession, examine_all
from lupin_cli.facts.base import Facts, Unknown
from lupin_cli.facts.link import Link
from lupin_cli.terminal import is_interrupt
from lupin_runtime.json_text import parse_json

if TYPE_CHECKING:
    from lupin_cli.connection.ssh import SshTarget

Collected = BundleItem | Omission

MAX_PLAYBOOK_JOURNALS = 10
MAX_FILE_BYTES = 2_000_000
# A run's files besides its logs. The recording is not collected: it is large and has images of the owner's greenhouse.
RUN_FILES = ("run.json", "state.json", "result.json", "sim_state.json")
_VARIABLES = ("PATH", "LANG", "LC_ALL", "TZ", "SHELL", "TERM", "LD_LIBRARY_PATH", "PYTHONPATH")
_VARIABLE_PREFIXES = ("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_", "LUPIN_", "AMENT_", "CYCLONEDDS_", "XDG_")


@dataclass
class Collector:
    """Collects from this machine and from robots, each over one connection. Close it at the end."""

    checks: Sequence[Check]
    plugin_errors: Sequence[Gap]  # each plug-in of the doctor that could not be loaded
    laptop: Target
    robots: Sequence[Robot] = ()
    config: Config | None = None
    sudo_passwords: dict[str, str] | None = None  # by robot
    max_age_s: float | None = None  # of system journal lines and playbook runs; None: lines since boot, and runs of any age

    def __post_init__(self) -> None:
        passwords = self.sudo_passwords or {}
        scopes = [
            DoctorScope(self.checks, self.plugin_errors, self.laptop, robot, self.config, passwords.get(robot.name))
            for robot in self.robots
        ] or [DoctorScope(self.checks, self.plugin_errors, self.laptop)]
        self.sessions = [DoctorSession(scope) for scope in scopes]
        self._results: dict[DoctorSession, DoctorResult] = {}

    def collect(self, on_progress: Callable[[str], None]) -> list[Collected]:
        """Collect the findings and facts of all machines, then the logs and settings of this machine and of each robot."""
        machines = " and ".join(["this machine", *(robot.name for robot in self.robots)])
        on_progress(f"running the doctor's probes on {machines} ...")
        found = list(self._diagnose())
        on_progress(f"reading system journals and settings of {machines} ...")
        with ThreadPoolExecutor(max_workers=MAX_PARALLEL_ROBOTS, thread_name_prefix="bundle") as pool:
            try:
                from_laptop = pool.submit(self._read_laptop)
                from_robots = list(pool.map(self._read_robot, self.sessions))
                return [*found, *from_laptop.result(), *(each for items in from_robots for each in items)]
            except BaseException:  # such as an interrupt: closing the connections stops the threads
                self.close()
                raise

    @property
    def links(self) -> list[Link]:
        """The link to each robot."""
        return [
            self._link(each) or Link(each.scope.name, "", "target", "no connection was attempted")
            for each in self.sessions
            if each.scope.robot is not None
        ]

    @property
    def secrets(self) -> list[str]:
        """The passwords that were given for sudo and for logins on the robots."""
        typed = list((self.sudo_passwords or {}).values())
        return typed + [secret for each in self.sessions if (robot := self._robot(each)) for secret in robot.secrets]

    def close(self) -> None:
        """Close the connections to the robots."""
        for session in self.sessions:
            session.close()

    def _link(self, session: DoctorSession) -> Link | None:
        result = self._results.get(session)
        return result.link if result else None

    def _robot(self, session: DoctorSession) -> SshTarget | None:
        """The robot over the session's connection; None if it did not answer."""
        result = self._results.get(session)
        return session.get_reachable_robot(result) if result else None

    def _diagnose(self) -> Iterator[Collected]:
        """Run the doctor, and yield the findings and facts of all machines."""
        try:
            examine_all(self.sessions, self._results.__setitem__)
        except Exception as error:  # if the doctor fails, the logs are still collected: they show why
            if is_interrupt(error):
                raise KeyboardInterrupt from error
            yield Omission("findings", FAILED, f"the doctor failed: {type(error).__name__}: {error}")
        results = [(each.scope, self._results[each]) for each in self.sessions if each in self._results]
        for scope, result in results:
            yield from _findings(scope.robot.name if scope.robot else "laptop", result.diagnosis, result.link)
        if results:
            yield from facts_items("laptop", results[0][1].snapshot.laptop)
        for scope, result in results:
            if result.snapshot.robot is not None:
                yield from facts_items(f"robots/{scope.name}", result.snapshot.robot)

    def _read_laptop(self) -> list[Collected]:
        return list(read_sources(self.laptop, sources_of(LAPTOP), "laptop", max_age_s=self.max_age_s, sudo=False))

    def _read_robot(self, session: DoctorSession) -> list[Collected]:
        if session.scope.robot is None:
            return []
        folder = f"robots/{session.scope.name}"
        link, robot = self._link(session), self._robot(session)
        item = BundleItem(f"{folder}/link.json", "how the robot was reached, or why not", to_plain_data(link))
        if robot is None:
            return [item, Omission(folder, UNREACHABLE, link.message if link else "no connection was attempted")]
        return [item, *read_sources(robot, sources_of(ROBOT), folder, max_age_s=self.max_age_s)]


# -- findings and facts


def _findings(name: str, diagnosis: Diagnosis, link: Link | None) -> Iterator[BundleItem]:
    text = encode(to_markdown(diagnosis, f"Diagnosis of {name}"))
    yield BundleItem(f"findings/{name}.md", "the doctor's findings, as text", text)
    yield BundleItem(f"findings/{name}.json", "the doctor's findings", to_dict(diagnosis, link))


def facts_items(folder: str, facts: Facts) -> Iterable[Collected]:
    """Yield the facts of a machine, and the raw output of each probe, so that parser bugs can be diagnosed."""
    table = {name: to_plain_data(value) for name, value in sorted(facts.values.items())}
    document = {"machine": facts.machine, "asked_ns": facts.probed_ns, "facts": table}
    yield BundleItem(f"{folder}/facts.json", "the facts as they were parsed", document)
    endings: dict[str, Any] = {}
    for name, output in sorted(facts.outputs.items()):
        endings[name] = {
            "status": output.status,
            "duration_s": round(output.duration_s, 3),
            "truncated": output.truncated,
            "stderr": output.stderr,
            "unknown": value.reason if isinstance(value := facts.values.get(name), Unknown) else None,
        }
        path = f"{folder}/probes/{name}.out"
        if output.stdout.strip():
            yield BundleItem(path, f"output of the probe {name}", encode(output.stdout))
        else:
            yield Omission(path, ABSENT, f"the probe printed nothing: {output.stderr.strip() or f'status {output.status}'}")
    yield BundleItem(f"{folder}/probes/index.json", "how each probe ended", endings)


def to_plain_data(value: Any) -> Any:
    """Convert a fact's value to JSON-serializable data: dataclasses become objects, sets sorted lists, other types strings."""
    if value is None or isinstance(value, (bool, int, str)):
        return value.value if isinstance(value, Enum) else value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, Unknown):
        return {"unknown": value.reason}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_plain_data(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): to_plain_data(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_plain_data(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return sorted((to_plain_data(item) for item in value), key=str)
    if isinstance(value, (bytes, bytearray)):
        return bytes(value).decode("utf-8", "backslashreplace")
    return str(value.value if isinstance(value, Enum) else value)


# -- Lupin's own files on this machine


def lupin_files(config: Path, options: dict[str, Any], max_age_s: float | None) -> Iterator[Collected]:
    """Yield version and environment, the inventory at `config`, the last run's logs, and the last playbook runs' journals."""
    yield _environment(options)
    yield _file_item(config, "laptop/lupin/lupin.toml", "the inventory of robots")
    yield from _last_run()
    yield from _playbook_journals(max_age_s)


def _environment(options: dict[str, Any]) -> BundleItem:
    installed = sorted({f"{each.name}=={each.version}" for each in importlib.metadata.distributions() if each.name})
    environment = {
        name: value for name, value in sorted(os.environ.items()) if name in _VARIABLES or name.startswith(_VARIABLE_PREFIXES)
    }
    content = {
        "lupin": __version__,
        "options": options,
        "python": sys.version,
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "user_id": os.getuid(),
        "packages": installed,
        "environment": environment,
    }
    return BundleItem("laptop/lupin/lupin.json", "version, platform, packages, environment", content)


def _file_item(path: Path, archive_path: str, description: str) -> Collected:
    """Return this machine's file at `path` as an item at `archive_path`, or an omission with the reason."""
    try:
        found = truncate_file(path, MAX_FILE_BYTES)
    except FileNotFoundError:
        return Omission(archive_path, ABSENT, f"there is no {path}")
    except OSError as error:
        return Omission(archive_path, UNREADABLE, f"{path}: {error.strerror}")
    remark = f"{found.missing} were left out of the middle" if found.missing else ""
    return BundleItem(archive_path, description, found.data, remark)


def _last_run() -> Iterator[Collected]:
    """Yield states and logs of the live run of `lupin up`, or of the last one."""
    from lupin_runtime.stack.runs import RunError, find_run

    try:
        run = find_run()
    except RunError as error:
        yield Omission("laptop/run", ABSENT, str(error))
        return
    folder = f"laptop/run/{run.id}"
    for name in RUN_FILES:
        if (run.path / name).exists():
            yield _file_item(run.path / name, f"{folder}/{name}", f"the last run: {name}")
    logs = sorted(run.logs.glob("*.log"))
    for log in logs:
        yield _file_item(log, f"{folder}/logs/{log.name}", f"the last run: log of {log.stem}")
    if not logs:
        yield Omission(f"{folder}/logs", ABSENT, "no process of the run has written a log")
    if run.recording.exists():
        size = run.recording.stat().st_size
        reason = f"the recording of {size} bytes stays on this machine: {run.recording}"
        yield Omission(f"{folder}/{run.recording.name}", TOO_BIG, reason)


def _playbook_journals(max_age_s: float | None) -> Iterator[Collected]:
    """Yield the newest journals of playbook runs, without the file contents that are stored for undo."""
    from lupin_cli.playbook.journal import journal_folder

    earliest = 0.0 if max_age_s is None else time.time() - max_age_s
    try:
        journals_by_mtime = [(path.stat().st_mtime, path) for path in journal_folder().glob("*.jsonl")]
    except OSError as error:
        yield Omission("laptop/playbooks", UNREADABLE, f"{journal_folder()}: {error.strerror}")
        return
    newest = [path for mtime, path in sorted(journals_by_mtime, reverse=True)[:MAX_PLAYBOOK_JOURNALS] if mtime >= earliest]
    if not newest:
        period = " in the requested period" if journals_by_mtime else ""
        yield Omission("laptop/playbooks", ABSENT, f"no playbook run{period}; journals are in {journal_folder()}")
    for path in newest:
        found = _file_item(path, f"laptop/playbooks/{path.name}", "journal of a playbook run")
        if isinstance(found, BundleItem):
            content, damaged = strip_undo_state(found.content.splitlines())
            remark = "; ".join(filter(None, (found.remark, f"{damaged} incomplete lines are left out" if damaged else "")))
            found = BundleItem(found.path, found.description, content, remark)
        yield found


def strip_undo_state(lines: Iterable[bytes]) -> tuple[bytes, int]:
    """Remove the `before` values from a playbook journal's lines. Returns the rest, and the number of unreadable lines.

    `before` holds whole files for undo, in which secrets cannot be recognized reliably. A truncated line may contain such a
    file too, so unreadable lines are dropped.
    """
    kept, unreadable = [], 0
    for line in lines:
        try:
            event = parse_json(line)
        except ValueError:
            unreadable += bool(line.strip())
            continue
        if isinstance(event, dict) and "before" in event:
            event["before"] = "left out"
        kept.append(encode(json.dumps(event, ensure_ascii=False) + "\n"))
    return b"".join(kept), unreadable
