"""The robot's part of the stack, as a systemd service: `python -m lupin_runtime.stack.onboard`.

It runs the drive bus, e-stop, arm, gripper and light strip in the environment in which it is started.
"""

from __future__ import annotations

from lupin_runtime.stack.service import exit_with, serve
from lupin_runtime.stack.table import ONBOARD, Options

WATCHED = ("estop", "drive")  # systemd restarts the unit if these do not respond


def onboard_options() -> Options:
    """Return the options that select the processes of the robot; all others run on the laptop."""
    off = dict.fromkeys(("slam", "navigation", "twin", "perception", "flowers", "mission", "record", "cameras"), False)
    return Options(target=ONBOARD, **off)  # type: ignore[arg-type]


if __name__ == "__main__":
    exit_with(serve(onboard_options(), WATCHED))
