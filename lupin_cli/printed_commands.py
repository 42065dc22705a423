"""The gate for the commands that Lupin tells an operator to type: every one can be pasted into a terminal of this machine.

What raises an error knows which command helps, but not always how the robot is named or reached from here. `complete` adds
that, and `print_next` prints it. Both repeat the inventory that this command was given with --config.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from lupin_cli.terminal import echo

# Programs that are typed on this machine, whatever machine the error is about.
_TYPED_HERE = ("chmod", "export", "lupin", "make", "mv", "ssh", "ssh-copy-id", "ssh-keygen")
# The commands of `lupin` that act on a robot and take --robot.
_ON_A_ROBOT = (
    "bundle",
    "deploy laptop",
    "deploy robot",
    "doctor",
    "home",
    "play",
    "sweep",
    "sync-clock",
    "transport show",
    "transport use",
    "wait",
)
_JOINT = re.compile(r""" (&&) |(;) |'[^']*'|"[^"]*"|\\.""")  # between two commands of a line, not inside quotes
_inventory: Path | None = None  # of --config


def repeat_inventory(path: Path | None) -> Path | None:
    """Callback of --config: repeat it from now on in every printed command that reads the inventory. Returns `path`."""
    global _inventory
    _inventory = path
    return path


def lupin(*words: str, robot: str = "") -> str:
    """Return the command `lupin WORDS`, quoted for a shell, on the robot of this name if one is given."""
    first_option = next((index for index, word in enumerate(words) if word.startswith("-")), len(words))
    named = ("--robot", robot) if robot else ()
    return shlex.join(["lupin", *words[:first_option], *named, *words[first_option:]])


def ssh(user: str, host: str, port: int = 22) -> str:
    """Return the command that logs in on a machine."""
    return shlex.join(["ssh", *(["-p", str(port)] if port != 22 else []), f"{user}@{host}" if user else host])


def over_ssh(login: str, command: str) -> str:
    """Return the line that runs `command` on the machine that `login` logs in to; with a terminal if sudo may ask there."""
    program, _, rest = login.partition(" ")
    with_terminal = re.search(r"\bsudo\b", command) is not None and program == "ssh" and not rest.startswith("-t ")
    return f"{program} -t {rest} {shlex.quote(command)}" if with_terminal else f"{login} {shlex.quote(command)}"


def complete(command: str, *, robot: str = "", login: str = "") -> str:
    """Return a command that can be pasted here.

    `command` is a command of `lupin`, or a script for the machine that an error is about. `robot` is the robot's name, empty
    for this machine; `login` the command that logs in there.
    """
    if not command or not command.strip():
        return ""
    if login and command.split()[0] not in _TYPED_HERE:
        return over_ssh(login, command)
    if joint := next((found for found in _JOINT.finditer(command) if found[1] or found[2]), None):
        first, second = command[: joint.start()], command[joint.end() :]
        return f"{complete(first, robot=robot)}{joint[0]}{complete(second, robot=robot)}"
    names_robot = any(word in ("-r", "--robot", "--all", "--local") for word in command.split())
    if robot and not names_robot and command.removeprefix("lupin ").startswith(_ON_A_ROBOT):
        command = f"{command} --robot {shlex.quote(robot)}"
    reads_inventory = command.startswith("lupin ") and command.removeprefix("lupin ").startswith((*_ON_A_ROBOT, "robots"))
    if _inventory is not None and reads_inventory and "--config" not in command.split():
        command = f"{command} --config {shlex.quote(str(_inventory))}"
    return command


def print_next(command: str, label: str = "next") -> None:
    """Print a command that helps, on standard error; nothing if there is none."""
    if command:
        echo(f"  {label}: {complete(command)}", err=True, wrap=False)  # a line break inside would be pasted, too
