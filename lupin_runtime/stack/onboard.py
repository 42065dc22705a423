"""The robot's part of the stack, as a systemd service: `python -m lupin_runtime.stack.onboard`.

It runs the drive bus, e-stop, arm, gripper, light strip and gamepad in the environment in which it is started. There,
LUPIN_ESTOP_BUTTON=no says that the robot has no e-stop button.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

from lupin_runtime.ending import exit_with
from lupin_runtime.environment import is_off
from lupin_runtime.safety.expected_sources import ESTOP_BUTTON
from lupin_runtime.stack.options import ONBOARD, Options
from lupin_runtime.stack.service import serve


def onboard_options(environment: Mapping[str, str]) -> Options:
    """Return the options of the robot's part of the stack."""
    return Options(target=ONBOARD, estop_button=not is_off(environment, ESTOP_BUTTON))


if __name__ == "__main__":
    exit_with(serve(onboard_options(os.environ)))
