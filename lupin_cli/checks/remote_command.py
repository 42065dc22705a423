"""Lines for a shell of the laptop, as findings print them, and what a person does by hand beside them."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from typing import TypedDict

from lupin_cli.checks.base import Snapshot
from lupin_cli.facts.account import ACCOUNT
from lupin_cli.facts.ros_processes import RosProcess
from lupin_cli.facts.shell import SHELL
from lupin_cli.facts.units import VENDOR, Unit
from lupin_cli.printed_commands import over_ssh

# Takes one assignment out of the lines `Environment=`, quoted or not. A line without any would reset what others set: it goes.
_REMOVE_ASSIGNMENT = (
    r"/^[[:space:]]*Environment=/{{s/\"{name}=[^\"]*\"//g;s/\x27{name}=[^\x27]*\x27//g;"
    r"s/(=|[[:space:]]){name}=[^[:space:]]*/\1/g;/Environment=[[:space:]]*$/d}}"
)
IN_NEW_TERMINAL = "in a new terminal"


class FixText(TypedDict, total=False):
    """The two texts of a fix, as `make_finding` takes them."""

    command: str
    instruction: str


def command_on_robot(snapshot: Snapshot, command: str) -> str:
    """Return the `ssh` line that runs `command` on the robot."""
    link = snapshot.link
    login = (link.login or f"ssh {link.address or link.robot}") if link is not None else "ssh localhost"
    return over_ssh(login, command)


def command_on(snapshot: Snapshot, machine: str, command: str) -> str:
    """Return the line that runs `command` on `machine` ("laptop" or "robot"), typed on the laptop."""
    return command_on_robot(snapshot, command) if machine == "robot" else command


def restart_unit(snapshot: Snapshot, *units: str) -> str:
    """Return the line that restarts units of the robot, the vendor's by default."""
    return command_on_robot(snapshot, f"sudo systemctl restart {' '.join(units or (VENDOR,))}")


def remove_assignments(snapshot: Snapshot, unit: Unit, variables: Iterable[str]) -> FixText:
    """Return how variables are taken out of the unit's files that set them; other variables of the same lines stay."""
    files = {name: unit.files_setting(name, unit.environment.get(name, "")) for name in variables}
    if not all(files.values()):
        return FixText(
            command=command_on_robot(snapshot, f"systemctl cat --no-pager {unit.name}"),
            instruction=f"take {', '.join(files)} out of the unit's files, then reload systemd and restart {unit.name}",
        )
    edits = [
        f"sudo sed -i -E {shlex.quote(_REMOVE_ASSIGNMENT.format(name=name))} {shlex.join(paths)}"
        for name, paths in files.items()
    ]
    restart = f"sudo systemctl reset-failed {unit.name} && sudo systemctl restart {unit.name}"
    script = " && ".join((*edits, "sudo systemctl daemon-reload", restart))
    return FixText(
        command=command_on_robot(snapshot, script), instruction=f"the command takes {', '.join(files)} out of the unit's files"
    )


def robot_option(snapshot: Snapshot) -> str:
    """Return ` --robot NAME` for a `lupin` command that acts on the robot of the snapshot; empty if none was selected."""
    return f" --robot {shlex.quote(snapshot.link.robot)}" if snapshot.link else ""


def show_transports(snapshot: Snapshot) -> str:
    """Return the line that measures the link and shows which other transport answers."""
    return f"lupin transport show{robot_option(snapshot)}"


def service_of(process: RosProcess) -> str:
    """Return the system service that a process belongs to; empty if a person started it."""
    group = process.group.rstrip("/")
    unit = group.rpartition("/")[2]
    return unit if unit.endswith(".service") and "/user.slice/" not in f"{group}/" else ""


def restart_processes(
    snapshot: Snapshot, machine: str, processes: Iterable[RosProcess], *, again: str = IN_NEW_TERMINAL
) -> FixText:
    """Return how processes start again: services by systemd; what a person started is ended, and started `again` by hand."""
    found = tuple(processes)
    by_hand = [process for process in found if machine == "laptop" or not service_of(process)]
    units = sorted({service_of(process) for process in found if process not in by_hand})
    commands = [f"sudo systemctl restart {' '.join(units)}"] if units else []
    if by_hand:
        commands.insert(0, f"{sudo_for(snapshot, machine, by_hand)}kill {' '.join(str(process.pid) for process in by_hand)}")
    text = FixText(command=command_on(snapshot, machine, " && ".join(commands)))
    if by_hand:
        names = ", ".join(dict.fromkeys(process.name for process in by_hand))
        text["instruction"] = f"the command ends {names}; then start it again {again}"
    return text


def sudo_for(snapshot: Snapshot, machine: str, processes: Iterable[RosProcess]) -> str:
    """Return `sudo ` if processes of the robot belong to another user than the one that logs in."""
    account = snapshot.robot_fact(ACCOUNT)
    is_own = machine == "laptop" or (account is not None and all(each.user_id == account.uid for each in processes))
    return "" if is_own else "sudo "


def source_exports(snapshot: Snapshot) -> str:
    """Return the line that gives a terminal Lupin's DDS set-up; empty if its place is not known."""
    shell = snapshot.laptop.get(SHELL)
    return f"source {shlex.quote(shell.exports_path)}" if shell is not None else ""
