"""A robot computer with Lupin's units on it, and the vendor's side running against a simulated robot."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from lupin_cli import units
from lupin_sim.host.checkout import RELEASE, lend

if TYPE_CHECKING:
    from lupin_sim.host import Host

SET_UP = ("source ~/.mirte_settings.sh", "source ~/mirte_ws/install/setup.bash")


def install_units(host: Host) -> None:
    """Put the rendered units there, with this project in the place of a release."""
    robot = host.robot
    lend(robot)
    for name, text in units.robot_units("mirte", RELEASE, SET_UP).items():
        assert robot.inside("sh", "-c", f"cat > /etc/systemd/system/{name}", stdin=text).status == 0
    done = robot.inside("sh", "-ec", "systemctl daemon-reload; systemctl enable --quiet lupin-onboard lupin-auto-home")
    assert done.status == 0, done.stderr


@pytest.fixture(scope="module")
def lupin_robot() -> Iterator[Host]:
    """Booted, with everything that `lupin deploy robot` makes of a robot. One for a whole file: a boot costs seconds."""
    from lupin_sim.host import Host
    from lupin_sim.host.missing import what_is_missing

    if missing := what_is_missing():
        pytest.skip(missing)
    with Host.start(vendor_robot=True) as host:
        install_units(host)
        yield host


@pytest.fixture
def robot_host(lupin_robot: Host) -> Host:
    """That robot with the vendor's stack up and nothing of Lupin started."""
    fresh = """systemctl stop lupin-auto-home lupin-onboard; systemctl reset-failed
systemctl restart mirte-ros && journalctl --rotate --vacuum-size=1"""
    done = lupin_robot.robot.inside("sh", "-c", fresh, timeout_s=60.0)
    assert done.status == 0, done.stderr
    return lupin_robot
