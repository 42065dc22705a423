"""`heal` on a robot whose vendor's stack really runs: stuck controllers become active, and a healthy robot is let be."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_cli import units
from lupin_cli.operations.controller_list import complaints, controller_states
from lupin_cli.runbook import play
from lupin_cli.target.destination import Destination
from lupin_cli.target.local import LocalTarget
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.trust import Trust
from lupin_sim.host import Host
from lupin_sim.host.checkout import RELEASE, lend
from lupin_sim.host.missing import what_is_missing

pytestmark = pytest.mark.host

SET_UP = ("source ~/.mirte_settings.sh", "source ~/mirte_ws/install/setup.bash")


@pytest.fixture(scope="module")
def deployed() -> Iterator[Host]:
    """A robot with the vendor's stack and Lupin's units on it."""
    if missing := what_is_missing():
        pytest.skip(missing)
    with Host.start(vendor_robot=True) as host:
        inside = host.robot.inside
        lend(host.robot)
        for name, text in units.robot_units("mirte", RELEASE, SET_UP).items():
            assert inside("sh", "-c", f"cat > /etc/systemd/system/{name}", stdin=text).status == 0
        assert inside("systemctl", "daemon-reload").status == 0
        yield host


@pytest.fixture
def targets(deployed: Host) -> Iterator[dict[str, Any]]:
    place = Destination(deployed.robot.eth0, 22, "mirte", (str(deployed.key),), identities_only=True)
    robot = SshTarget("mirte", place, Trust(Path("/nonexistent"), users=Path(deployed.known_hosts)))
    with deployed.on_laptop():
        yield {"robot": robot, "laptop": LocalTarget()}
        robot.close()


def test_a_robot_is_healed_once(deployed: Host, targets: dict[str, Any], tmp_path: Path) -> None:
    options: dict[str, Any] = {"journal": tmp_path, "confirm": lambda question: "arm moves" in question}
    first = play("heal", targets, **options)
    assert first.state == "done", (first.message, first.next_command)
    assert play("heal", targets, **options).changed == 0
    deployed.robot.fault("controllers-stuck")
    assert "pid_wheels_controller" in " ".join(complaints(controller_states(targets["robot"])))
    dry = play("heal", targets, dry_run=True, **options)
    assert (dry.state, dry.steps[-1].state) == ("done", "would-change")
    again = play("heal", targets, **options)
    # The stack was restarted by the fault, and auto-home is a part of it: it may have healed them before the last step looked.
    assert (again.state, again.steps[-1].state in ("changed", "same")) == ("done", True), again.message
    assert play("heal", targets, **options).changed == 0
