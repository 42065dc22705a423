"""`heal` on a robot whose vendor's stack really runs: stuck controllers become active, and a healthy robot is let be."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.operations.controller_list import complaints, controller_states
from lupin_cli.runbook import play
from lupin_cli.target.destination import Destination
from lupin_cli.target.local import LocalTarget
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.trust import Trust
from lupin_sim.host import Host

pytestmark = pytest.mark.host


@pytest.fixture
def targets(lupin_robot: Host) -> Iterator[dict[str, Any]]:
    place = Destination(lupin_robot.robot.eth0, 22, "mirte", (str(lupin_robot.key),), identities_only=True)
    robot = SshTarget("mirte", place, Trust(Path("/nonexistent"), users=Path(lupin_robot.known_hosts)))
    with lupin_robot.on_laptop():
        yield {"robot": robot, "laptop": LocalTarget()}
        robot.close()


def test_a_robot_is_healed_once(lupin_robot: Host, targets: dict[str, Any], tmp_path: Path) -> None:
    options: dict[str, Any] = {"journal": tmp_path, "confirm": lambda question: "arm moves" in question}
    first = play("heal", targets, **options)
    assert first.state == "done", (first.message, first.next_command)
    assert play("heal", targets, **options).changed == 0
    lupin_robot.robot.fault("controllers-stuck")
    assert "pid_wheels_controller" in " ".join(complaints(controller_states(targets["robot"])))
    dry = play("heal", targets, dry_run=True, **options)
    assert (dry.state, dry.steps[-1].state) == ("done", "would-change")
    again = play("heal", targets, **options)
    # The stack was restarted by the fault, and auto-home is a part of it: it may have healed them before the last step looked.
    assert (again.state, again.steps[-1].state in ("changed", "same")) == ("done", True), again.message
    assert play("heal", targets, **options).changed == 0
