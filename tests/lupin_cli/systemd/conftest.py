"""A simulated computer with Lupin's units, on which the vendor's stack runs the simulated robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from lupin_sim.host import Host


@pytest.fixture
def robot_host(lupin_host: Host) -> Host:
    """Restart the vendor's stack and stop Lupin's units."""
    script = """systemctl stop lupin-auto-home lupin-cameras lupin-onboard; systemctl reset-failed
systemctl restart mirte-ros && journalctl --rotate --vacuum-size=1"""
    done = lupin_host.robot.run_as_root("sh", "-c", script, timeout_s=60.0)
    assert done.status == 0, done.stderr
    return lupin_host
