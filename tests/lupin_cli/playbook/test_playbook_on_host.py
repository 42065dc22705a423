"""Shipped playbooks on a booted simulated computer: a dry run, a run, a second run that changes nothing, an undo."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.local import LocalTarget
from lupin_cli.connection.ssh import SshTarget
from lupin_cli.playbook import Result, find_playbook_run, play
from lupin_cli.playbook.undo import undo
from lupin_sim.host import Host
from tests.support.waiting import wait_until

pytestmark = pytest.mark.host

Play = Callable[..., Result]


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Create a temporary home of the operator, in which playbooks write the laptop's files."""
    folder = tmp_path / "home"
    folder.mkdir()
    (folder / ".bashrc").write_text("source /opt/ros/humble/setup.bash\n")
    for name in [name for name in os.environ if name.startswith("XDG_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(folder))
    monkeypatch.setenv("SHELL", "/bin/bash")
    return folder


@pytest.fixture
def targets(fresh_host: Host, home: Path) -> Iterator[dict[str, Any]]:  # noqa: ARG001 -- the fixture must have run
    place = Destination(fresh_host.robot.eth0, 22, "mirte", (str(fresh_host.key),), identities_only=True)
    robot = SshTarget("mirte", place, KnownHosts(Path("/nonexistent"), user_file=Path(fresh_host.known_hosts)))
    with fresh_host.on_laptop():
        yield {"robot": robot, "laptop": LocalTarget()}
        robot.close()


def changed_steps(result: Result) -> list[str]:
    assert result.state == "done", (result.message, result.next_command)
    return [step.name for step in result.steps if step.state in ("changed", "would-change")]


def listens(targets: dict[str, Any]) -> bool:
    return bool(targets["robot"].run("ss -H -lnu 'sport = :11811'").stdout.strip())


def test_killed_discovery_server_is_replaced_once(fresh_host: Host, targets: dict[str, Any]) -> None:
    wait_until(lambda: listens(targets), "a discovery server")
    fresh_host.robot.inject_fault("server-killed")
    wait_until(lambda: not listens(targets), "the end of the discovery server")
    assert changed_steps(play("recover-discovery", targets, dry_run=True)) == ["Start a discovery server on every address"]
    assert not listens(targets)
    first = play("recover-discovery", targets)
    assert changed_steps(first) == ["Start a discovery server on every address"] and listens(targets)
    assert changed_steps(play("recover-discovery", targets)) == []
    assert undo(find_playbook_run(first.run), targets).state == "done" and not listens(targets)


@pytest.mark.usefixtures("fresh_host")
def test_clock_sync_is_installed_once_and_undone(targets: dict[str, Any]) -> None:
    files = "cat /etc/chrony/chrony.conf /etc/chrony/conf.d/* 2>/dev/null; ls /usr/local/lib/lupin /etc/systemd/system"
    before = targets["robot"].run(files).stdout
    given = {"laptop_serves": False}
    assert len(changed_steps(play("install-clock-sync", targets, given, dry_run=True))) >= 5
    assert targets["robot"].run(files).stdout == before
    first = play("install-clock-sync", targets, given)
    assert "Enable the boot-time unit" in changed_steps(first)
    after = targets["robot"].run("grep -c '^ *makestep' /etc/chrony/chrony.conf; systemctl is-enabled lupin-clock-sync")
    assert after.stdout.split() == ["0", "enabled"]
    assert targets["robot"].run("systemctl is-active lupin-clock-sync").stdout.strip() == "inactive"
    assert changed_steps(play("install-clock-sync", targets, given)) == []
    assert undo(find_playbook_run(first.run), targets).state == "done"
    assert targets["robot"].run(files).stdout == before


def test_wrong_clock_is_set_while_the_stack_is_down(fresh_host: Host, targets: dict[str, Any]) -> None:
    given = {"controllers": False}
    invocation = targets["robot"].run("systemctl show -p InvocationID --value mirte-ros").stdout
    wait_until(lambda: listens(targets), "a discovery server")
    assert changed_steps(play("sync-clock", targets, given)) == []
    assert targets["robot"].run("systemctl show -p InvocationID --value mirte-ros").stdout == invocation
    fresh_host.robot.inject_fault("clock-wrong", offset_s=-16440.0)
    steps = fresh_host.robot.state["clock_steps"]
    planned = changed_steps(play("sync-clock", targets, given, dry_run=True))
    assert {"Stop the vendor's stack", "Set the clock"} <= set(planned)
    assert fresh_host.robot.state["clock_steps"] == steps
    done = changed_steps(play("sync-clock", targets, given))
    assert [name for name in done if name in ("Stop the vendor's stack", "Set the clock", "Start the vendor's stack")] == [
        "Stop the vendor's stack",
        "Set the clock",
        "Start the vendor's stack",
    ]
    assert fresh_host.robot.state["clock_steps"] == steps + 1
    assert abs(fresh_host.robot.state["clock_offset_s"]) < 1.0
    assert targets["robot"].run("systemctl is-active mirte-ros").stdout.strip() == "active" and listens(targets)
    assert changed_steps(play("sync-clock", targets, given)) == []


def test_stack_is_started_again_if_the_clock_cannot_be_set(fresh_host: Host, targets: dict[str, Any]) -> None:
    fresh_host.robot.inject_fault("clock-wrong", offset_s=-16440.0)
    targets["robot"].run("mv /usr/bin/date /usr/bin/date.real; printf '#!/bin/sh\\n[ \"$1\" = -s ] && exit 1\\n"
                         "exec /usr/bin/date.real \"$@\"\\n' >/usr/bin/date; chmod 755 /usr/bin/date", root=True)  # fmt: skip
    result = play("sync-clock", targets, {"controllers": False})
    assert (result.state, result.message.split(":")[0]) == ("failed", "Set the clock"), result.message
    assert targets["robot"].run("systemctl is-active mirte-ros").stdout.strip() == "active"


def test_multihomed_robot_becomes_single_homed_and_back(fresh_host: Host, targets: dict[str, Any]) -> None:
    on_wlan0 = "ip -4 -o address show dev wlan0 | wc -l"
    wait_until(lambda: targets["robot"].run(on_wlan0).stdout.strip() == "1", "the address on wlan0")
    boots = fresh_host.robot.state["boots"]
    assert play("single-home", targets).state == "declined"
    assert fresh_host.robot.state["boots"] == boots
    assert targets["robot"].run("systemctl is-active mirte-ap mirte-wifi-watchdog").stdout.split() == ["active"] * 2
    first = play("single-home", targets, confirm=lambda question: "reboot it? Its stack stops" in question)
    assert "Reboot the robot without its access point" in changed_steps(first)
    assert fresh_host.robot.state["boots"] == boots + 1
    assert targets["robot"].run(on_wlan0).stdout.strip() == "0" and listens(targets)
    assert changed_steps(play("single-home", targets)) == []
    back = undo(find_playbook_run(first.run), targets)
    assert back.state == "done", back.message
    wait_until(lambda: targets["robot"].run(on_wlan0).stdout.strip() == "1", "the address on wlan0")


def test_access_point_that_carries_the_connection_stays_on(fresh_host: Host, targets: dict[str, Any]) -> None:
    place = Destination(fresh_host.robot.wlan0, 22, "mirte", (str(fresh_host.key),), identities_only=True)
    over_ap = SshTarget("mirte", place, KnownHosts(Path("/nonexistent"), user_file=Path(fresh_host.known_hosts)))
    try:
        result = play("single-home", {**targets, "robot": over_ap}, confirm=lambda _: True)
    finally:
        over_ap.close()
    assert result.state == "failed" and "runs over its access point" in result.message
    assert result.next_command == "lupin transport show --robot mirte"
    assert targets["robot"].run("systemctl is-active mirte-ap").stdout.strip() == "active"


@pytest.mark.usefixtures("fresh_host")
def test_wired_demo_is_set_up_once(home: Path, targets: dict[str, Any]) -> None:
    given = {"reboot": False}
    targets["robot"].run("echo 'export MIRTE_FASTDDS=false' >~/.mirte_settings.sh")
    dry = play("demo-wired", targets, given, dry_run=True)
    assert dry.state == "done" and not (home / ".config").exists(), dry.message
    first = play("demo-wired", targets, given, confirm=lambda _: True)
    assert {"Let the vendor's stack start a discovery server", "Let the laptop join the robot over the cable"} <= set(
        changed_steps(first)
    )
    assert 'ROS_DISCOVERY_SERVER="10.42.0.1:11811"' in (home / ".config/lupin/ros-env.sh").read_text()
    assert listens(targets)
    assert changed_steps(play("demo-wired", targets, given)) == []
    back = undo(find_playbook_run(first.run), targets)
    assert back.state == "done", back.message
    assert not (home / ".config/lupin/ros-env.sh").exists()
    assert (home / ".bashrc").read_text() == "source /opt/ros/humble/setup.bash\n"
    assert targets["robot"].run("cat ~/.mirte_settings.sh").stdout == "export MIRTE_FASTDDS=false\n"


@pytest.mark.usefixtures("fresh_host", "home")
def test_access_point_demo_turns_the_access_point_on(targets: dict[str, Any]) -> None:
    targets["robot"].run("systemctl disable --now mirte-wifi-watchdog mirte-ap", root=True)
    assert "Start the access point" in changed_steps(play("demo-access-point", targets, dry_run=True))
    first = play("demo-access-point", targets)
    assert {"Start the access point", "Let the laptop join the robot through its access point"} <= set(changed_steps(first))
    assert changed_steps(play("demo-access-point", targets)) == []
    assert undo(find_playbook_run(first.run), targets).state == "done"
    assert targets["robot"].run("systemctl is-enabled mirte-ap").stdout.strip() == "disabled"


def test_router_demo_without_networkmanager_changes_nothing(targets: dict[str, Any]) -> None:
    result = play("demo-router", targets, {"ssid": "travel", "key": "long enough", "robot_ip": "10.0.0.7"})
    assert result.state == "failed" and "NetworkManager does not run on it" in result.message
    assert result.changed == 0


def test_run_with_a_pulled_cable_is_resumed(fresh_host: Host, targets: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lupin_cli.connection.connect.UNACKNOWLEDGED_MS", 500)

    def pull(event: Any) -> None:
        if event.kind == "step" and event.step == "Install the boot-time unit":
            fresh_host.robot.inject_fault("cable-cut", link="eth0")

    result = play("install-clock-sync", targets, {"laptop_serves": False}, on_event=pull)
    assert (result.state, result.exit_code) == ("unreachable", 3), result.message
    fresh_host.robot.undo_fault("cable-cut", link="eth0")
    targets["robot"].close()
    fresh_host.robot.wait_ready()
    again = play("install-clock-sync", targets, resume=True)
    assert (again.state, again.run) == ("done", result.run), again.message
    assert targets["robot"].run("systemctl is-enabled lupin-clock-sync").stdout.strip() == "enabled"


@pytest.mark.usefixtures("fresh_host")
def test_laptop_is_deployed_and_removed(home: Path, targets: dict[str, Any]) -> None:
    """The robot's computer plays the laptop, since the test may change its systemd and chrony."""
    laptop = {"laptop": targets["robot"]}
    serving = "ss -H -lnu 'sport = :123' | wc -l; ls /etc/chrony/conf.d"
    before = targets["robot"].run(serving).stdout
    dry = play("deploy-laptop", laptop, dry_run=True)
    assert dry.changed >= 3 and targets["robot"].run(serving).stdout == before
    first = play("deploy-laptop", laptop)
    assert {"Let new terminals join the robot's graph", "serve-clock / Let chrony serve the robot"} <= set(changed_steps(first))
    assert int(targets["robot"].run(serving).stdout.split()[0]) >= 1
    script = f". {home}/.config/lupin/ros-env.sh; echo $ROS_DISCOVERY_SERVER; cat {home}/.bashrc"
    assert targets["robot"].run(script).stdout.startswith("10.42.0.1:11811\n# lupin dds")
    assert changed_steps(play("deploy-laptop", laptop)) == []
    removed = play("remove-laptop", laptop)
    assert "Stop serving the time to the robot" in changed_steps(removed)
    assert targets["robot"].run(serving).stdout == before
    assert changed_steps(play("remove-laptop", laptop)) == []
    assert undo(find_playbook_run(removed.run), laptop).state == "done"
    assert changed_steps(play("deploy-laptop", laptop)) == []
    assert undo(find_playbook_run(first.run), laptop).state == "done"
    assert targets["robot"].run(f"ls {home}/.config/lupin").stdout == ""


@pytest.mark.usefixtures("fresh_host")
def test_dry_run_of_shipped_playbooks_changes_nothing(home: Path, targets: dict[str, Any]) -> None:
    look = "find /etc /usr/local /opt /home -type f | sort | xargs md5sum; systemctl list-unit-files --no-legend"
    before = targets["robot"].run(look, root=True).stdout
    given: dict[str, dict[str, Any]] = {"sweep": {"machine": "robot"}, "install-clock-sync": {"laptop_serves": False}}
    for name in ("recover-discovery", "single-home", "demo-wired", "demo-access-point", "pin-wifi", "sync-clock", "sweep"):
        result = play(name, targets, given.get(name), dry_run=True)
        assert result.state == "done", f"{name}: {result.message}"
    assert targets["robot"].run(look, root=True).stdout == before
    assert list(home.iterdir()) == [home / ".bashrc"]
