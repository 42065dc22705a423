"""The robot's part of the stack, as a systemd service: `python -m lupin_runtime.stack.onboard`.

It runs the drive bus, e-stop, arm, gripper and light strip in the environment in which it is started.
"""

from __future__ import annotations

from lupin_runtime.stack.options import ONBOARD, Options
from lupin_runtime.stack.service import exit_with, serve

if __name__ == "__main__":
    exit_with(serve(Options(target=ONBOARD)))
