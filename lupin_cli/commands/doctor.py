"""`lupin doctor`: diagnose the laptop, the robot and the link between them."""

from __future__ import annotations

import contextlib
import json
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from lupin_cli.connection.options import ALL, ASK_SUDO, CONFIG, HOST, LIMIT, LOCAL, ROBOT
from lupin_cli.exit_codes import INTERRUPTED, NO_RESULT, SUCCESS, USAGE_ERROR
from lupin_cli.printed_commands import lupin, print_next
from lupin_cli.terminal import confirm, echo, ending_in_order, erase_status_line, is_interactive, is_interrupt, show_status_line

if TYPE_CHECKING:
    from lupin_cli.checks.base import Check, Finding, Gap
    from lupin_cli.connection.inventory import Config, Robot
    from lupin_cli.doctor.fixes import FixResult
    from lupin_cli.doctor.session import DoctorResult, DoctorScope, DoctorSession

WATCH_PERIOD_S = 2.0


def command(
    robot: ROBOT = None,
    local: LOCAL = False,
    host: HOST = "",
    every: ALL = False,
    limit: LIMIT = None,
    fix: Annotated[bool, typer.Option("--fix", help="Play the safe fixes; ask before the others.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="With --fix: play all fixes without asking.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="With --fix: show what would change; change nothing.")] = False,
    only: Annotated[
        list[str] | None, typer.Option("--only", help="Run only this check; a name or a pattern like dds.*.")
    ] = None,
    skip: Annotated[list[str] | None, typer.Option("--skip", help="Skip this check; a name or a pattern.")] = None,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Examine repeatedly and print changes.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON on standard output.")] = False,
    fields: Annotated[
        str, typer.Option("--fields", metavar="FIELDS", help="With --json: print only these, such as status,findings.id.")
    ] = "",
    junit: Annotated[Path | None, typer.Option("--junit", help="Write a JUnit report to this file.")] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print Markdown.")] = False,
    verbose: Annotated[
        int, typer.Option("--verbose", "-v", count=True, help="Show all lines of evidence and the topics; -vv also each check.")
    ] = 0,
    list_checks: Annotated[bool, typer.Option("--list", help="List the checks and exit.")] = False,
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
) -> None:
    """Diagnose this machine, the robot and the link between them: cause, evidence and fix of each problem.

    It examines the default robot, or with --local this machine and any ROS graph that runs on it. It changes nothing without
    --fix.

    Exit status: 0 healthy, 1 something needs attention, 2 usage, 3 the robot cannot be reached, 4 the doctor failed or could
    not examine everything. With --fix, the status describes the state afterwards.

    Example: lupin doctor --robot greenhouse --fix
    """
    if watch and (every or (robot and len(robot) > 1)):
        _usage("--watch examines one robot; name it with --robot")
    if as_json and markdown:
        _usage("--json and --markdown both print to standard output; choose one")
    if fields and not as_json:
        _usage("--fields needs --json")
    if (yes or dry_run) and not fix:
        _usage("--yes and --dry-run need --fix")
    patterns = only or (), skip or ()
    if list_checks:
        for check in _checks(*patterns)[0]:
            first_line = (check.find.__doc__ or "").strip().partition("\n")[0]
            echo(f"{check.name:28}{first_line}")
        raise typer.Exit(SUCCESS)
    logins = _logins(robot, local, host, every, limit, config, ask_sudo)
    options = _Options(fix, yes, dry_run, watch, as_json, _parse_fields(fields), junit, markdown, verbose)
    sessions: list[DoctorSession] = []
    try:
        from lupin_cli.doctor.session import DoctorSession, examine_all

        shown = sys.stderr.isatty() and not (as_json or markdown)
        with _progress([each.name for each, *_ in logins], shown) as show_layer:
            sessions = [DoctorSession(scope, show_layer) for scope in _scopes(logins, *patterns)]
            examinations = [_Examination(each, result) for each, result in zip(sessions, examine_all(sessions))]
        status = _run(examinations, options)
    except (typer.Exit, KeyboardInterrupt):
        raise
    except typer.Abort:  # Ctrl-C at a question
        status = INTERRUPTED
    except Exception as error:
        if is_interrupt(error):
            raise KeyboardInterrupt from error
        # Scripts distinguish a sick robot from a broken doctor by the status, so every defect exits with NO_RESULT.
        if "--debug" in sys.argv:
            raise
        echo(f"lupin doctor: {type(error).__name__}: {error}", err=True)
        print_next(lupin("--debug", *sys.argv[1:]), "for the stack trace")
        status = NO_RESULT
    finally:
        for session in sessions:
            session.close()
    raise typer.Exit(status)


@dataclass(frozen=True)
class _Options:
    """What to do with the first examination, and how to print it."""

    fix: bool
    yes: bool
    dry_run: bool
    watch: bool
    as_json: bool
    fields: tuple[str, ...]  # of the JSON; empty for all
    junit: Path | None
    markdown: bool
    verbose: int


@dataclass
class _Examination:
    """A session, its latest result, and the fixes that were played in it."""

    session: DoctorSession
    result: DoctorResult
    fixes: list[FixResult] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.session.scope.name


def _usage(message: str) -> NoReturn:
    echo(f"lupin doctor: {message}; see: lupin doctor --help", err=True)
    raise typer.Exit(USAGE_ERROR)


def _parse_fields(text: str) -> tuple[str, ...]:
    """Return the fields of `--fields`. An unknown one is found before anything is examined."""
    fields = tuple(word for word in text.replace(" ", "").split(",") if word)
    if fields:
        from lupin_cli.doctor.engine import Diagnosis
        from lupin_cli.doctor.report import UnknownFieldError, select_fields, to_dict

        try:
            select_fields({**to_dict(Diagnosis((), ())), "fixes": [], "treatments": []}, fields)
        except UnknownFieldError as error:
            _usage(f"--fields: {error}")
    return fields


def _checks(only: Sequence[str], skip: Sequence[str]) -> tuple[tuple[Check, ...], tuple[Gap, ...]]:
    """Return the selected checks, and the plug-ins that could not be loaded."""
    from lupin_cli.checks.table import UnknownCheck, built_in, plugged_in, select

    added, plugin_errors = plugged_in()
    try:
        return select((*built_in(), *added), only, skip), plugin_errors
    except UnknownCheck as error:
        echo(f"lupin doctor: {error}", err=True)
        raise typer.Exit(USAGE_ERROR) from error


_Login = tuple["Robot", "Config", "str | None"]  # with the sudo password


def _logins(
    names: list[str] | None, local: bool, host: str, every: bool, limit: str | None, config: Path | None, ask_sudo: bool
) -> list[_Login]:
    """Return the selected robots with config and sudo password; none to examine this machine alone."""
    from lupin_cli.connection.options import ask_sudo_passwords, reporting_errors, select_subject

    with reporting_errors("doctor"):
        inventory, chosen = select_subject(config, names, local=local, host=host, every=every, limit=limit)
        if inventory is None:
            return []
        passwords = ask_sudo_passwords(chosen) if ask_sudo else {}
        return [(each, inventory, passwords.get(each.name)) for each in chosen]


def _scopes(logins: Sequence[_Login], only: Sequence[str], skip: Sequence[str]) -> list[DoctorScope]:
    """Return one scope for each robot, or one for this machine alone."""
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.doctor.session import DoctorScope

    checks, plugin_errors = _checks(only, skip)
    if not logins:
        return [DoctorScope(checks, plugin_errors, LocalTarget())]
    return [DoctorScope(checks, plugin_errors, LocalTarget(), *login) for login in logins]


def _run(examinations: list[_Examination], options: _Options) -> int:
    """Play fixes, print the results, watch; return the exit status."""
    from lupin_cli.doctor.report import exit_status

    if options.fix:
        with ending_in_order():
            for each in examinations:
                _play_fixes(each, options)
    _print(examinations, options)
    for each in examinations:
        _announce_lost_memory(each, options)
    if options.junit is not None:
        _write_junit(examinations, options.junit)
    if options.watch:
        _watch(examinations[0], options)
    return max(exit_status(each.result.diagnosis, each.result.link) for each in examinations)


def _play_fixes(examination: _Examination, options: _Options) -> None:
    def note(fix: FixResult) -> None:
        examination.fixes.append(fix)
        if not options.as_json:
            _print_fix(fix)

    interactive = sys.stdin.isatty() and not (options.as_json or options.markdown or options.dry_run)
    accept = _Consent(options.yes or options.dry_run, interactive=interactive)
    session = examination.session
    examination.result = session.apply_fixes(examination.result, accept, note, dry_run=options.dry_run)
    examination.fixes = [session.judge_fix(fix, examination.result) for fix in examination.fixes]
    for fix in examination.fixes if not (options.as_json or options.dry_run) else ():
        _print_outcome(fix)


def _announce_lost_memory(examination: _Examination, options: _Options) -> None:
    """Say that the end of this login takes the stack's shared memory away, before it ends; on a terminal, offer to keep it."""
    session, result = examination.session, examination.result
    finding = session.find_endangered_memory(result)
    if finding is None:
        return
    echo(
        f"{examination.name}: ten seconds after this login ends, unless the same user has another one, logind removes the "
        "shared memory of the running stack: nodes that join later see names and get no samples",
        err=True,
    )
    may_ask = is_interactive() and not (options.as_json or options.markdown or options.dry_run)
    if may_ask and confirm(f"Keep it: play {finding.fix.playbook}"):
        played = session.play_fix(finding)
        examination.fixes.append(played)
        _print_fix(played)
        if played.state == "done":
            from lupin_cli.doctor.report import verdict

            examination.result = session.examine()
            echo(verdict(examination.result.diagnosis, examination.result.link))
            return
    print_next(finding.fix.command, "keep it with")


@contextlib.contextmanager
def _progress(names: Sequence[str], shown: bool) -> Iterator[Callable[[str], None]]:
    """Show which machines are being asked, until the block ends. Yield a function that shows which layer is measured."""
    started_s = time.monotonic()

    def show(text: str) -> None:
        if shown:
            seconds = f"[{time.monotonic() - started_s:5.1f} s] " if text else ""
            show_status_line(f"{seconds}{text or asked} ...")

    asked = f"asking {', '.join(names) or 'this machine'}"
    show("")
    try:
        yield lambda layer: show(f"not everything arrives here; measuring the path: {layer}")
    finally:
        if shown:
            erase_status_line()


class _Consent:
    """Whether a finding's playbook may be played: a safe one always, another one if a person agrees."""

    def __init__(self, yes: bool, interactive: bool) -> None:
        self._yes, self._interactive = yes, interactive

    def __call__(self, finding: Finding) -> bool:
        if finding.fix.safe or self._yes:
            return True
        if not self._interactive:
            return False
        echo(f"{finding.where}: {finding.cause}", err=True)
        if finding.fix.instruction:
            echo(f"  {finding.fix.instruction}", err=True)
        return confirm(f"Play {finding.fix.playbook}" + (f" ({finding.fix.command})" if finding.fix.command else ""))


def _print_fix(fix: FixResult) -> None:
    verb = "would play" if fix.dry_run else "played"
    ending = f"{fix.changed} changed" if fix.state == "done" else f"{fix.state}: {fix.message}"
    echo(f"{verb} {fix.playbook} for {fix.finding}: {ending}", err=True)
    for change in fix.changes if fix.dry_run else ():
        echo(f"  {change}", err=True)


def _print_outcome(fix: FixResult) -> None:
    """Print whether a fix that was played has healed its finding. Why one failed was printed when it was played."""
    if fix.state == "healed":
        echo(f"healed: {fix.finding}", err=True)
    elif fix.state == "done":
        echo(f"not healed: {fix.finding}: {fix.message}", err=True)


def _print(examinations: list[_Examination], options: _Options) -> None:
    from lupin_cli.doctor.report import print_terminal, to_markdown

    if options.as_json:
        reports = [_report(each, options) for each in examinations]
        print(json.dumps(reports[0] if len(reports) == 1 else {"robots": reports}, indent=2))
        return
    for each in examinations:
        if options.markdown:
            echo(to_markdown(each.result.diagnosis, f"Diagnosis of {each.name}"), wrap=False)
            continue
        if len(examinations) > 1:
            echo()
        print_terminal(each.result.diagnosis, each.result.link, verbose=options.verbose)


def _report(examination: _Examination, options: _Options) -> dict[str, Any]:
    from lupin_cli.doctor.report import UnknownFieldError, select_fields, to_dict

    result = examination.result
    fixes = [fix.to_dict() for fix in examination.fixes]
    # `treatments` is the name of the last version, kept for one more.
    report = {**to_dict(result.diagnosis, result.link), "fixes": fixes, "treatments": fixes}
    try:
        return select_fields(report, options.fields) if options.fields else report
    except UnknownFieldError as error:
        _usage(f"--fields: {error}")


def _write_junit(examinations: list[_Examination], path: Path) -> None:
    from lupin_cli.doctor.report import to_junit

    suites = [to_junit(each.result.diagnosis, each.name) for each in examinations]
    try:
        path.write_text('<?xml version="1.0" encoding="utf-8"?>\n<testsuites>\n' + "\n".join(suites) + "\n</testsuites>\n")
    except OSError as error:
        echo(f"lupin doctor: cannot write {path}: {error.strerror}; name a file in a folder that exists", err=True)
        raise typer.Exit(NO_RESULT) from error


def _watch(examination: _Examination, options: _Options) -> None:
    """Examine until SIGINT or SIGTERM, and print each change of state. `examination` keeps the last result."""
    from lupin_cli.doctor.report import print_terminal

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)
    shown = _state(examination.result)
    try:
        while True:
            time.sleep(WATCH_PERIOD_S)
            result = examination.result = examination.session.examine()
            if _state(result) == shown:
                continue
            shown = _state(result)
            if options.as_json:
                print(json.dumps(_report(examination, options)), flush=True)
            else:
                echo(f"-- {time.strftime('%H:%M:%S')}")
                print_terminal(result.diagnosis, result.link, verbose=options.verbose)
                sys.stdout.flush()
    except KeyboardInterrupt:
        return


def _state(result: DoctorResult) -> object:
    """Return what --watch compares: root causes and gaps, but not the numbers in their evidence."""
    diagnosis = result.diagnosis
    return sorted((root.finding.id, root.finding.where) for root in diagnosis.roots), diagnosis.unknown, diagnosis.check_errors
