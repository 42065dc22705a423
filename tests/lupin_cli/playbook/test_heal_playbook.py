"""`heal` on a booted robot that runs the vendor's stack: stuck controllers become active, a healthy robot stays unchanged."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.local import LocalTarget
from lupin_cli.connection.ssh import SshTarget
from lupin_cli.operations.controller_states import controllers_probe, find_inactive, parse_controllers
from lupin_cli.operations.shell import run_probe
from lupin_cli.playbook import play
from lupin_sim.host import Host

pytestmark = pytest.mark.host


@pytest.fixture
def targets(lupin_host: Host) -> Iterator[dict[str, Any]]:
    destination = Destination(lupin_host.robot.eth0, 22, "mirte", (str(lupin_host.key),), identities_only=True)
    robot = SshTarget("mirte", destination, KnownHosts(Path("/nonexistent"), user_file=Path(lupin_host.known_hosts)))
    with lupin_host.on_laptop():
        yield {"robot": robot, "laptop": LocalTarget()}
        robot.close()


def test_heal_activates_stuck_controllers_and_is_idempotent(lupin_host: Host, targets: dict[str, Any], tmp_path: Path) -> None:
    options: dict[str, Any] = {"journal": tmp_path, "confirm": lambda question: "Move the arm" in question}
    first_run = play("heal", targets, **options)
    assert first_run.state == "done", (first_run.message, first_run.next_command)
    assert play("heal", targets, **options).changed == 0
    lupin_host.robot.inject_fault("controllers-stuck")
    assert "pid_wheels_controller" in " ".join(
        find_inactive(parse_controllers(run_probe(targets["robot"], controllers_probe())))
    )
    dry_run_result = play("heal", targets, dry_run=True, **options)
    assert (dry_run_result.state, dry_run_result.steps[-1].state) == ("done", "would-change")
    second_run = play("heal", targets, **options)
    assert second_run.state == "done", second_run.message
    # The fault restarts the stack with auto-home, which may have activated the controllers before the last step examines them.
    assert second_run.steps[-1].state in ("changed", "same"), second_run.message
    assert play("heal", targets, **options).changed == 0
