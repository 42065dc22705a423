"""`lupin deploy`: install Lupin on a robot, or the laptop's part of the link on this machine; or remove either."""

from __future__ import annotations

import contextlib
import json
import threading
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lupin_cli.command_group import command_group
from lupin_cli.connection.inventory import ConfigError
from lupin_cli.connection.options import ALL, ASK_SUDO, BREAK_LEASE, CONFIG, LIMIT, ROBOT, reporting_errors
from lupin_cli.exit_codes import FAILURE, USAGE_ERROR, worst
from lupin_cli.printed_commands import complete, lupin, print_next
from lupin_cli.terminal import echo, ending_in_order

if TYPE_CHECKING:
    from lupin_cli.connection.base import Target
    from lupin_cli.connection.inventory import Config, Robot

app = command_group(
    "Install Lupin on a robot, or the laptop's part of the link on this machine; --remove removes either.",
    "lupin deploy robot --dry-run",
    no_args_is_help=True,
)

DRY_RUN = typer.Option(False, "--dry-run", help="Show what would change; change nothing.")
DIFF = typer.Option(False, "--diff", help="Print how many files change by folder, and the diffs of units.")
JSON = typer.Option(False, "--json", help="Print only JSON on standard output.")
YES = typer.Option(False, "--yes", "-y", help="Answer every question with yes.")
REMOVE = typer.Option(False, "--remove", help="Remove what was installed.")


@app.command("robot")
def deploy_robot(
    robot: ROBOT = None,
    every: ALL = False,
    limit: LIMIT = None,
    dry_run: bool = DRY_RUN,
    diff: bool = DIFF,
    rollback: bool = typer.Option(False, "--rollback", help="Return to the previous release."),
    force: bool = typer.Option(False, "--force", help="Install the release again even if the robot has it, undamaged."),
    trust_key: bool = typer.Option(
        False, "--trust-key", help="Let the robot trust your release key besides those of other operators."
    ),
    remove: bool = REMOVE,
    break_lease: BREAK_LEASE = "",
    check: bool = typer.Option(True, "--check/--no-check", help="Run the doctor on the robot afterwards."),
    yes: bool = YES,
    config: CONFIG = None,
    ask_sudo: ASK_SUDO = False,
    as_json: bool = JSON,
) -> None:
    """Install this machine's release on a robot and run it: only changed files are copied, and only a complete release runs.

    The release is signed with your release key, which is made when it is first needed, and verified on the robot before it
    becomes current and at every start. A robot that trusts other operators' keys refuses yours until you pass --trust-key.
    A release that is damaged is installed again.

    Exit status: 0 done or nothing to do, 1 a step failed, or the doctor found a problem afterwards, 2 usage, 3 a robot cannot
    be reached, 130 interrupted.

    Example: lupin deploy robot --dry-run --diff
    """
    if rollback + remove + force > 1:
        echo("lupin deploy robot: --rollback, --remove and --force exclude each other", err=True)
        raise typer.Exit(USAGE_ERROR)
    if remove and trust_key:
        echo("lupin deploy robot: --remove removes the trusted keys, so it excludes --trust-key", err=True)
        raise typer.Exit(USAGE_ERROR)
    from lupin_cli.commands.play import ProgressPrinter, ask_operator, print_result
    from lupin_cli.connection.inventory import load as load_config
    from lupin_cli.connection.options import ask_sudo_passwords, open_target, select_robots
    from lupin_cli.operations.base import OperationError
    from lupin_cli.playbook import Result, play
    from lupin_cli.playbook.fleet import play_on_all

    playbook = "remove-robot" if remove else "deploy-robot"
    with ending_in_order(), reporting_errors("deploy robot"):
        inventory = load_config(config)
        robots = select_robots(inventory, robot, every=every, limit=limit)
        passwords = ask_sudo_passwords(robots) if ask_sudo else {}
        progress = ProgressPrinter(quiet=as_json, several=len(robots) > 1, diff=diff)
        confirm = ask_operator(yes, progress)

        def deploy_one(each: Robot, stop: threading.Event) -> Result:
            with contextlib.closing(open_target(each, inventory, sudo_password=passwords.get(each.name))) as target:
                command = _command(each.name, rollback=rollback, remove=remove, force=force, trust_key=trust_key)
                try:
                    variables = {} if remove else _variables(each, target, rollback, force, trust_key)
                    return play(
                        playbook, {"robot": target}, variables, dry_run=dry_run, diff=diff,
                        confirm=confirm, on_event=progress, stop=stop, take_lease_from=break_lease, command=command,
                    )  # fmt: skip
                except OperationError as error:
                    next_command = complete(error.next_command, robot=each.name, login=target.login_command)
                    return Result(playbook, each.name, "failed", message=str(error), next_command=next_command)

        results = play_on_all(robots, lambda each: each.name, playbook, deploy_one)
        for result in results:
            print_result(result, as_json)
        codes = [result.exit_code for result in results]
        changed = [each for each, result in zip(robots, results) if result.state == "done" and result.changed]
        problems = (
            {each.name: _examine(each, inventory, as_json) for each in changed} if check and not (dry_run or remove) else {}
        )
        if as_json:
            plain = [{**result.plain(), "doctor": problems.get(result.robot)} for result in results]
            print(json.dumps(plain if len(plain) != 1 else plain[0]))
        for name, found in problems.items():
            if found:
                codes.append(FAILURE)
                if not as_json:
                    print_next(lupin("doctor", "--fix", robot=name))
                    print_next(lupin("deploy", "robot", "--rollback", robot=name), "or return to the previous release")
        raise typer.Exit(worst(codes))


def _command(robot: str, **options: bool) -> str:
    """Return what the operator types for one robot."""
    return lupin("deploy", "robot", *(f"--{name.replace('_', '-')}" for name, given in options.items() if given), robot=robot)


def _variables(robot: Robot, target: Target, rollback: bool, force: bool, trust_key: bool) -> dict[str, Any]:
    from lupin_cli.operations.base import OperationError
    from lupin_cli.operations.release_transfer import read_installed
    from lupin_cli.release.paths import setup_lines

    variables: dict[str, Any] = {"set_up": list(setup_lines(robot.ros_setup)), "force": force, "trust_key": trust_key}
    if rollback:
        state = read_installed(target)
        if not state.previous:
            raise OperationError(
                f"{target.name} has no release before {state.current or 'the first one'}",
                lupin("deploy", "robot", robot=target.name),
            )
        variables["release"] = state.previous
    return variables


def _examine(robot: Robot, inventory: Config, quiet: bool) -> list[str]:
    """Run the doctor on the robot and return the ids of its problems; print all findings unless `quiet`."""
    from lupin_cli.checks.base import Severity
    from lupin_cli.checks.table import built_in
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.doctor.report import print_terminal
    from lupin_cli.doctor.session import DoctorScope, DoctorSession

    session = DoctorSession(DoctorScope(built_in(), (), LocalTarget(), robot, inventory))
    try:
        result = session.examine()
        if not quiet:
            print_terminal(result.diagnosis, result.link)
        return [finding.id for finding in result.diagnosis.findings if finding.severity is Severity.PROBLEM]
    finally:
        session.close()


@app.command("laptop")
def deploy_laptop(
    robot: ROBOT = None,
    dry_run: bool = DRY_RUN,
    diff: bool = DIFF,
    remove: bool = REMOVE,
    variables: Annotated[
        list[str] | None, typer.Option("-v", "--var", help="Set a playbook variable: robot_ip, network or ssid, as name=value.")
    ] = None,
    yes: bool = YES,
    config: CONFIG = None,
    as_json: bool = JSON,
) -> None:
    """Install the laptop's part of the link: DDS environment, NTP server, priority of the robot's WiFi.

    It is set up for the default robot or the one of --robot: for its address in a network of this machine, that network and its
    WiFi. Without an inventory, it is set up for a robot as it is delivered, on its cable.

    Exit status: 0 done or nothing to do, 1 a step failed, 2 usage, 130 interrupted.

    Example: lupin deploy laptop --dry-run
    """
    from lupin_cli.commands.play import ProgressPrinter, ask_operator, parse_variables, print_result
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.playbook import JournalError, PlaybookError, load, play

    playbook = "remove-laptop" if remove else "deploy-laptop"
    progress = ProgressPrinter(quiet=as_json, several=False, diff=diff)
    with ending_in_order(), reporting_errors("deploy laptop"):
        try:
            # The variables of both directions: what is removed has fewer.
            given = parse_variables(load("deploy-laptop"), variables or [])
            name, chosen = _laptop_variables(robot, config, remove, given)
            unused = {variable.name for variable in load("deploy-laptop").variables} - {
                variable.name for variable in load(playbook).variables
            }
            words = ["--remove"] * remove + [word for each in variables or [] for word in ("-v", each)]
            result = play(
                playbook, {"laptop": LocalTarget()}, {key: value for key, value in chosen.items() if key not in unused},
                dry_run=dry_run, diff=diff, confirm=ask_operator(yes, progress), on_event=progress,
                command=lupin("deploy", "laptop", *words, robot=name),
            )  # fmt: skip
        except PlaybookError as error:
            raise ConfigError(str(error)) from error
        except JournalError as error:
            raise ConfigError(str(error), error.next_command) from error
        if as_json:
            print(json.dumps(result.plain()))
        print_result(result, as_json)
        raise typer.Exit(result.exit_code)


def _laptop_variables(
    names: list[str] | None, path: Path | None, remove: bool, given: dict[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Return the robot's name, empty for one as it is delivered, and the playbook's variables. Raises ConfigError."""
    from lupin_cli.connection.inventory import Robot
    from lupin_cli.connection.inventory import load as load_config
    from lupin_cli.connection.options import select_robots
    from lupin_cli.link.laptop_variables import choose_variables, own_networks, saved_wifi

    inventory = load_config(path)
    if not (inventory.robots or names or "robot_ip" in given):
        return "", given
    if remove and not names and not inventory.default_robot and len(inventory.robots) > 1:
        return "", given  # what is removed is the same for every robot, except its WiFi
    if "robot_ip" in given and not names:
        return "", {**choose_variables(Robot("", {"": given["robot_ip"]}), own_networks(), saved_wifi()), **given}
    chosen = select_robots(inventory, names)
    if len(chosen) != 1:
        raise ConfigError("this machine joins one robot's graph; name one with --robot")
    (one,) = chosen
    if "robot_ip" in given:
        one = replace(one, addresses={"": given["robot_ip"]}, transport="")
    return one.name, {**choose_variables(one, own_networks(), saved_wifi()), **given}
