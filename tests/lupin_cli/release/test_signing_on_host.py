"""Signed releases on the simulated computer: what was changed is named, refused at the start, and repaired by a deploy."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest
from typer.testing import Result

from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_sim.host import Host

Lupin = Callable[..., Result]
pytestmark = pytest.mark.host
VERIFY = "/usr/bin/python3 -I /usr/local/lib/lupin/verify-release /opt/lupin/current"
READ_CURRENT_ID = "basename $(readlink /opt/lupin/current)"
# Found by a glob, because the path names the robot's Python.
PICK_FILE = "ls /opt/lupin/current/venv/lib/python3*/site-packages/lupin_runtime/stack/onboard.py"
REFUSALS = "journalctl -b -u lupin-onboard -o cat | grep 'is not as it was signed'"


def output_of(host: Host, command: str) -> str:
    return host.robot.run_as_root("sh", "-c", command).stdout.strip()


@pytest.fixture
def deployed(robot_host: Host, lupin: Lupin) -> str:
    """Deploy this machine's release, and return its id."""
    done = lupin("deploy", "robot", "--no-check")
    assert done.exit_code == 0, done.output
    return output_of(robot_host, READ_CURRENT_ID)


def test_changed_byte_is_named_refused_and_repaired(robot_host: Host, deployed: str, lupin: Lupin) -> None:
    assert output_of(robot_host, f"{VERIFY} && echo ok") == "ok"
    path = output_of(robot_host, PICK_FILE)
    refused = robot_host.robot.run_as_root("su", "mirte", "-c", f"echo '# mine' >> {path}")
    assert refused.status != 0 and "Permission denied" in refused.stderr, "only root may change a release"

    output_of(robot_host, f"printf X | dd of={path} bs=1 seek=100 conv=notrunc")
    output_of(robot_host, "systemctl restart --no-block lupin-onboard")
    log = wait_until(
        lambda: output_of(robot_host, REFUSALS), lambda: output_of(robot_host, "journalctl -b -u lupin-onboard"), timeout_s=60.0
    )
    relative = path.removeprefix("/opt/lupin/current/")
    assert f"release {deployed} is not as it was signed: {relative} (changed); next, on the laptop: lupin deploy robot" in log
    assert output_of(robot_host, "systemctl is-active lupin-onboard") != "active"

    found = {each["id"]: each for each in json.loads(lupin("doctor", "--json").stdout)["findings"]}
    assert found["release-damaged"]["evidence"] == [f"{path} (changed)"], found
    assert found["release-damaged"]["fix"]["command"] == "lupin deploy robot --robot mirte"

    repaired = lupin("deploy", "robot", "--no-check")
    assert repaired.exit_code == 0, repaired.output
    assert f"install release {deployed} again, because of damaged files: {relative} (changed)" in repaired.output
    assert output_of(robot_host, "systemctl is-active lupin-onboard") == "active"
    again = lupin("deploy", "robot", "--no-check")
    assert (again.exit_code, "= Install the release" in again.output) == (0, True), again.output


@pytest.mark.usefixtures("deployed")
def test_foreign_key_is_refused_until_it_is_trusted(robot_host: Host, lupin: Lupin, monkeypatch: pytest.MonkeyPatch) -> None:
    current = output_of(robot_host, READ_CURRENT_ID)
    monkeypatch.setenv("XDG_STATE_HOME", os.environ["HOME"] + "/another-operators")
    refused = lupin("deploy", "robot", "--no-check", "--force")
    assert refused.exit_code == 1, refused.output
    assert "the robot runs only releases that are signed with a key it trusts" in refused.output
    assert "next: lupin deploy robot --trust-key --robot mirte" in refused.output
    assert output_of(robot_host, READ_CURRENT_ID) == current

    declined = lupin("deploy", "robot", "--no-check", "--force", "--trust-key")  # nobody answers the question
    assert declined.exit_code == 1 and "not confirmed" in declined.output, declined.output
    assert output_of(robot_host, "wc -l < /etc/lupin/release-signers") == "1"

    trusted = lupin("deploy", "robot", "--no-check", "--force", "--trust-key", "--yes")
    assert trusted.exit_code == 0, trusted.output
    assert output_of(robot_host, "wc -l < /etc/lupin/release-signers") == "2"
    again = lupin("deploy", "robot", "--no-check")
    assert (again.exit_code, "= Install the release" in again.output) == (0, True), again.output
