"""`lupin doctor`: what is wrong, why, and what mends it."""

from __future__ import annotations

import contextlib
import json
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lupin_cli.robot_options import ALL, ASK_SUDO, CONFIG, LIMIT

if TYPE_CHECKING:
    from lupin_cli.checks.base import Check, Finding
    from lupin_cli.config import Config, Robot
    from lupin_cli.diagnosis import Diagnosis
    from lupin_cli.examination import Examination, Treatment

HEALTHY, ATTENTION, USAGE, UNREACHABLE, FAILED = 0, 1, 2, 3, 4
INTERRUPTED = 130  # at a question
WATCH_PERIOD_S = 2.0


def command(
    robot: Annotated[str, typer.Option("--robot", "-r", help="A robot of lupin.toml, or [user@]host[:port].")] = "",
    host: Annotated[str, typer.Option("--host", help="The robot at this address, whatever lupin.toml says.")] = "",
    every: ALL = False,
    limit: LIMIT = None,
    fix: Annotated[bool, typer.Option("--fix", help="Mend what may be mended unasked; ask for the rest.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="With --fix: mend without asking.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="With --fix: show what would be changed.")] = False,
    only: Annotated[list[str] | None, typer.Option("--only", help="Only this check; a name or a pattern, as in dds.*.")] = None,
    skip: Annotated[list[str] | None, typer.Option("--skip", help="Not this check; a name or a pattern.")] = None,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Keep looking; say what changes.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, alone on standard output.")] = False,
    junit: Annotated[Path | None, typer.Option("--junit", help="Write a JUnit report to this file.")] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print Markdown.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Show all lines of evidence.")] = False,
    list_checks: Annotated[bool, typer.Option("--list", help="List the checks and end.")] = False,
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Find out what is wrong with this machine, the robot and the way between them: cause, evidence and cure.

    Without --robot it examines this machine and whatever graph runs on it. Nothing is changed without --fix.

    Exit status: 0 healthy, 1 something needs attention, 2 usage, 3 the robot can't be reached, 4 the doctor could not look.
    With --fix it tells the state afterwards.
    """
    if robot and host:
        _usage("--robot and --host exclude each other")
    if (every or limit) and (robot or host):
        _usage("--all examines every robot of lupin.toml; name one with --robot, or take some with --all --limit PATTERN")
    if every and watch:
        _usage("--watch looks at one robot; name it with --robot")
    if as_json and markdown:
        _usage("--json and --markdown both want standard output; write one of them at a time")
    if (yes or dry_run) and not fix:
        _usage("--yes and --dry-run go with --fix")
    patterns = only or (), skip or ()
    if list_checks:
        for check in _checks(*patterns)[0]:
            typer.echo(f"{check.name:28}{(check.find.__doc__ or '').strip().splitlines()[0] if check.find.__doc__ else ''}")
        raise typer.Exit(HEALTHY)
    robots = _robots(robot, host, every, limit, config, ask_sudo)
    examinations: list[Examination] = []
    try:
        with _asking([each.name for each, *_ in robots], shown=sys.stderr.isatty() and not (as_json or markdown)):
            examinations = _set_out(robots)
            _examine(examinations, *patterns)
        status = _run(examinations, fix, yes, dry_run, watch, as_json, junit, markdown, verbose)
    except (typer.Exit, KeyboardInterrupt):
        raise
    except typer.Abort:
        status = INTERRUPTED
    except Exception as error:
        # Scripts tell by the status whether robot or doctor is ill, so no defect may leave with another one.
        if "--debug" in sys.argv:
            raise
        typer.echo(f"lupin doctor: {type(error).__name__}: {error}; the whole stack: lupin --debug doctor ...", err=True)
        status = FAILED
    finally:
        for examination in examinations:
            examination.close()
    raise typer.Exit(status)


def _usage(message: str) -> None:
    typer.echo(f"lupin doctor: {message}; see: lupin doctor --help", err=True)
    raise typer.Exit(USAGE)


def _checks(only: Sequence[str], skip: Sequence[str]) -> tuple[tuple[Check, ...], tuple[str, ...]]:
    from lupin_cli.checks.table import UnknownCheck, built_in, plugged_in, select

    added, broken = plugged_in()
    try:
        return select((*built_in(), *added), only, skip), broken
    except UnknownCheck as error:
        typer.echo(f"lupin doctor: {error}", err=True)
        raise typer.Exit(USAGE) from error


def _robots(
    robot: str, host: str, every: bool, limit: str | None, config_path: Path | None, ask_sudo: bool
) -> list[tuple[Robot, Config, str | None]]:
    """Those that were meant, each with its inventory and sudo's password; none for this machine alone."""
    from lupin_cli.config import Config, load
    from lupin_cli.robot_options import ask_sudo_password, named, reporting, select

    if not (robot or host or every or limit):
        return []
    with reporting("doctor"):
        inventory = load(config_path)
        if host:
            inventory = Config(inventory.path)  # an address means itself, also where a robot is called the same
        chosen = select(inventory, None, every=True, limit=limit) if every or limit else [named(inventory, host or robot)]
        return [(each, inventory, ask_sudo_password(each.name) if ask_sudo else None) for each in chosen]


def _set_out(robots: Sequence[tuple[Robot, Config, str | None]]) -> list[Examination]:
    """Begin to reach the robots, and only then read how to examine them."""
    ways = []
    if robots:
        from lupin_cli.robot_options import Way

        ways = [Way(*each) for each in robots]
        # The way there takes longest, so what opens it is loaded first, and alone: two imports side by side take turns.
        from lupin_cli.target import ssh  # noqa: F401
    from lupin_cli.examination import Examination
    from lupin_cli.target.local import LocalTarget

    if not robots:
        return [Examination((), (), LocalTarget())]
    return [Examination((), (), LocalTarget(), *each, way) for each, way in zip(robots, ways)]


def _run(
    examinations: list[Examination],
    fix: bool,
    yes: bool,
    dry_run: bool,
    watch: bool,
    as_json: bool,
    junit: Path | None,
    markdown: bool,
    verbose: bool,
) -> int:
    from lupin_cli.report import exit_status

    treatments: dict[int, list[Treatment]] = {}
    if fix:
        for examination in examinations:
            told = treatments.setdefault(id(examination), [])
            accept = _Consent(yes, interactive=sys.stdin.isatty() and not (as_json or markdown))
            for treatment in examination.treatments(accept, dry_run=dry_run):
                told.append(treatment)
                if not as_json:
                    _tell(treatment)
    _print(examinations, treatments, as_json, markdown, verbose)
    if junit is not None:
        _write_junit(examinations, junit)
    if watch:
        _watch(examinations[0], as_json, verbose)
    return max(exit_status(_of(examination), examination.link) for examination in examinations)


def _of(examination: Examination) -> Diagnosis:
    assert examination.diagnosis is not None
    return examination.diagnosis


@contextlib.contextmanager
def _asking(names: Sequence[str], shown: bool) -> Iterator[None]:
    """A line that tells who is asked, as long as it takes."""
    if shown:
        print(f"asking {', '.join(names) or 'this machine'} ...", end="", file=sys.stderr, flush=True)
    try:
        yield
    finally:
        if shown:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def _examine(examinations: list[Examination], only: Sequence[str], skip: Sequence[str]) -> None:
    # While a robot lets us in there is time to read what to ask it.
    checks, broken = _checks(only, skip)
    for each in examinations:
        each.checks, each.broken = checks, broken
    if len(examinations) == 1:
        examinations[0].examine()
    else:
        from lupin_cli.examination import examine_all

        examine_all(examinations)


class _Consent:
    """Whether a finding's playbook may be played: the safe ones unasked, the others with a person's leave."""

    def __init__(self, yes: bool, interactive: bool) -> None:
        self._yes, self._interactive = yes, interactive

    def __call__(self, finding: Finding) -> bool:
        if finding.fix.safe or self._yes:
            return True
        if not self._interactive:
            return False
        typer.echo(f"{finding.where}: {finding.cause}", err=True)
        return typer.confirm(f"Play {finding.fix.playbook} ({finding.fix.command})", default=False, err=True)


def _tell(treatment: Treatment) -> None:
    verb = "would play" if treatment.dry_run else "played"
    ending = f"{treatment.changed} changed" if treatment.state == "done" else f"{treatment.state}: {treatment.message}"
    typer.echo(f"{verb} {treatment.playbook} for {treatment.finding}: {ending}", err=True)
    for line in treatment.lines if treatment.dry_run else ():
        typer.echo(f"  {line}", err=True)


def _print(
    examinations: list[Examination], treatments: dict[int, list[Treatment]], as_json: bool, markdown: bool, verbose: bool
) -> None:
    from lupin_cli.examination import treatment_dict
    from lupin_cli.report import print_terminal, to_dict, to_markdown

    if as_json:
        told = [
            {
                **to_dict(_of(each), each.link),
                "treatments": [treatment_dict(treatment) for treatment in treatments.get(id(each), [])],
            }
            for each in examinations
        ]
        print(json.dumps(told[0] if len(told) == 1 else {"robots": told}, indent=2))
        return
    for each in examinations:
        name = each.robot.name if each.robot else "this machine"
        if markdown:
            print(to_markdown(_of(each), f"Diagnosis of {name}"))
            continue
        if len(examinations) > 1:
            print(f"{name}:")
        print_terminal(_of(each), verbose=verbose)


def _write_junit(examinations: list[Examination], path: Path) -> None:
    from lupin_cli.report import to_junit

    suites = [to_junit(_of(each), each.robot.name if each.robot else "this machine") for each in examinations]
    try:
        path.write_text('<?xml version="1.0" encoding="utf-8"?>\n<testsuites>\n' + "\n".join(suites) + "\n</testsuites>\n")
    except OSError as error:
        typer.echo(f"lupin doctor: can't write {path}: {error.strerror}; name a file in a folder that exists", err=True)
        raise typer.Exit(FAILED) from error


def _watch(examination: Examination, as_json: bool, verbose: bool) -> None:
    from lupin_cli.report import print_terminal, to_dict

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)  # asked to end, it ends as by Ctrl-C: with the status of how things stand
    told = _state(examination)
    try:
        while True:
            time.sleep(WATCH_PERIOD_S)
            examination.examine()
            if _state(examination) == told:
                continue
            told = _state(examination)
            if as_json:
                print(json.dumps(to_dict(_of(examination), examination.link)), flush=True)
            else:
                print(f"-- {time.strftime('%H:%M:%S')}")
                print_terminal(_of(examination), verbose=verbose)
                sys.stdout.flush()
    except KeyboardInterrupt:
        return


def _state(examination: Examination) -> object:
    """What counts as a change: which causes there are and what can't be looked at, not every number in their evidence."""
    diagnosis = _of(examination)
    return sorted((root.finding.id, root.finding.where) for root in diagnosis.roots), diagnosis.unknown, diagnosis.broken
