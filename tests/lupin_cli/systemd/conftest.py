"""A simulated computer with Lupin's units, on which the vendor's stack runs the simulated robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from lupin_sim.host import Host


@pytest.fixture
def robot_host(lupin_robot: Host) -> Host:
    """The robot with the vendor's stack up and Lupin's units stopped."""
    script = """systemctl stop lupin-auto-home lupin-cameras lupin-onboard; systemctl reset-failed
systemctl restart mirte-ros && journalctl --rotate --vacuum-size=1"""
    done = lupin_robot.robot.inside("sh", "-c", script, timeout_s=60.0)
    assert done.status == 0, done.stderr
    return lupin_robot
