"""Shipped playbooks on a robot's computer that really boots: a dry run first, then for real, then again, then back."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.runbook import Result, find_run, play
from lupin_cli.runbook.undo import undo
from lupin_cli.target.destination import Destination
from lupin_cli.target.local import LocalTarget
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.trust import Trust
from lupin_sim.host import Host

pytestmark = pytest.mark.host

Play = Callable[..., Result]


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home of the operator's own: what a playbook writes on the laptop stays in there."""
    folder = tmp_path / "home"
    folder.mkdir()
    (folder / ".bashrc").write_text("source /opt/ros/humble/setup.bash\n")
    for name in [name for name in os.environ if name.startswith("XDG_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(folder))
    monkeypatch.setenv("SHELL", "/bin/bash")
    return folder


@pytest.fixture
def targets(fresh_host: Host, home: Path) -> Iterator[dict[str, Any]]:
    place = Destination(fresh_host.robot.eth0, 22, "mirte", (str(fresh_host.key),), identities_only=True)
    robot = SshTarget("mirte", place, Trust(Path("/nonexistent"), users=Path(fresh_host.known_hosts)))
    with fresh_host.on_laptop():
        yield {"robot": robot, "laptop": LocalTarget()}
        robot.close()


def changed(result: Result) -> list[str]:
    assert result.state == "done", (result.message, result.next_command)
    return [step.name for step in result.steps if step.state in ("changed", "would-change")]


def until(condition: Callable[[], bool], limit_s: float = 20.0) -> None:
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def listens(targets: dict[str, Any]) -> bool:
    return bool(targets["robot"].run("ss -H -lnu 'sport = :11811'").stdout.strip())


def test_a_server_that_was_killed_is_replaced_once(fresh_host: Host, targets: dict[str, Any]) -> None:
    until(lambda: listens(targets))
    fresh_host.robot.fault("server-killed")
    until(lambda: not listens(targets))
    assert changed(play("recover-discovery", targets, dry_run=True)) == ["A discovery server listens on every address"]
    assert not listens(targets)
    first = play("recover-discovery", targets)
    assert changed(first) == ["A discovery server listens on every address"] and listens(targets)
    assert changed(play("recover-discovery", targets)) == []
    assert undo(find_run(first.run), targets).state == "done" and not listens(targets)


def test_the_boot_time_clock_is_installed_once_and_taken_back(fresh_host: Host, targets: dict[str, Any]) -> None:
    files = "cat /etc/chrony/chrony.conf /etc/chrony/conf.d/* 2>/dev/null; ls /usr/local/lib/lupin /etc/systemd/system"
    before = targets["robot"].run(files).stdout
    given = {"laptop_serves": False}
    assert len(changed(play("install-clock-sync", targets, given, dry_run=True))) >= 5
    assert targets["robot"].run(files).stdout == before
    first = play("install-clock-sync", targets, given)
    assert "It runs at every boot" in changed(first)
    after = targets["robot"].run("grep -c '^ *makestep' /etc/chrony/chrony.conf; systemctl is-enabled lupin-clock-sync")
    assert after.stdout.split() == ["0", "enabled"]
    assert targets["robot"].run("systemctl is-active lupin-clock-sync").stdout.strip() == "inactive"
    assert changed(play("install-clock-sync", targets, given)) == []
    assert undo(find_run(first.run), targets).state == "done"
    assert targets["robot"].run(files).stdout == before


def test_a_wrong_clock_is_set_while_the_stack_is_down_and_a_right_one_left_alone(
    fresh_host: Host, targets: dict[str, Any]
) -> None:
    given = {"controllers": False}
    began = targets["robot"].run("systemctl show -p InvocationID --value mirte-ros").stdout
    until(lambda: listens(targets))
    assert changed(play("sync-clock", targets, given)) == []
    assert targets["robot"].run("systemctl show -p InvocationID --value mirte-ros").stdout == began
    fresh_host.robot.fault("clock-wrong", offset_s=-16440.0)
    steps = fresh_host.robot.state["clock_steps"]
    would = changed(play("sync-clock", targets, given, dry_run=True))
    assert {"The vendor's stack is stopped", "The clock is set"} <= set(would)
    assert fresh_host.robot.state["clock_steps"] == steps
    done = changed(play("sync-clock", targets, given))
    assert [
        name for name in done if name in ("The vendor's stack is stopped", "The clock is set", "The vendor's stack is up")
    ] == ["The vendor's stack is stopped", "The clock is set", "The vendor's stack is up"]
    assert fresh_host.robot.state["clock_steps"] == steps + 1
    assert abs(fresh_host.robot.state["clock_offset_s"]) < 1.0
    assert targets["robot"].run("systemctl is-active mirte-ros").stdout.strip() == "active" and listens(targets)
    assert changed(play("sync-clock", targets, given)) == []


def test_a_stack_that_is_down_is_not_left_down_where_the_clock_cannot_be_set(fresh_host: Host, targets: dict[str, Any]) -> None:
    fresh_host.robot.fault("clock-wrong", offset_s=-16440.0)
    targets["robot"].run("mv /usr/bin/date /usr/bin/date.real; printf '#!/bin/sh\\n[ \"$1\" = -s ] && exit 1\\n"
                         "exec /usr/bin/date.real \"$@\"\\n' >/usr/bin/date; chmod 755 /usr/bin/date", root=True)  # fmt: skip
    result = play("sync-clock", targets, {"controllers": False})
    assert (result.state, result.message.split(":")[0]) == ("failed", "The clock is set"), result.message
    assert targets["robot"].run("systemctl is-active mirte-ros").stdout.strip() == "active"


def test_a_dual_homed_robot_becomes_single_homed_and_the_access_point_comes_back(
    fresh_host: Host, targets: dict[str, Any]
) -> None:
    on_wlan0 = "ip -4 -o address show dev wlan0 | wc -l"
    until(lambda: targets["robot"].run(on_wlan0).stdout.strip() == "1")
    boots = fresh_host.robot.state["boots"]
    assert play("single-home", targets).state == "declined"
    assert fresh_host.robot.state["boots"] == boots
    first = play("single-home", targets, resume=True, confirm=lambda question: "rebooted" in question)
    assert "The robot has started anew without it" in changed(first)
    assert fresh_host.robot.state["boots"] == boots + 1
    assert targets["robot"].run(on_wlan0).stdout.strip() == "0" and listens(targets)
    assert changed(play("single-home", targets)) == []
    back = undo(find_run(first.run), targets)
    assert back.state == "done", back.message
    until(lambda: targets["robot"].run(on_wlan0).stdout.strip() == "1")


def test_an_access_point_that_carries_us_is_not_switched_off(fresh_host: Host, targets: dict[str, Any]) -> None:
    place = Destination(fresh_host.robot.wlan0, 22, "mirte", (str(fresh_host.key),), identities_only=True)
    over_ap = SshTarget("mirte", place, Trust(Path("/nonexistent"), users=Path(fresh_host.known_hosts)))
    try:
        result = play("single-home", {**targets, "robot": over_ap}, confirm=lambda _: True)
    finally:
        over_ap.close()
    assert result.state == "failed" and "runs over its access point" in result.message
    assert result.next_command == "lupin transport use wired"
    assert targets["robot"].run("systemctl is-active mirte-ap").stdout.strip() == "active"


def test_the_wired_demo_is_set_up_once(fresh_host: Host, home: Path, targets: dict[str, Any]) -> None:
    given = {"reboot": False}
    targets["robot"].run("echo 'export MIRTE_FASTDDS=false' >~/.mirte_settings.sh")
    dry = play("demo-wired", targets, given, dry_run=True)
    assert dry.state == "done" and not (home / ".config").exists(), dry.message
    first = play("demo-wired", targets, given, confirm=lambda _: True)
    assert {"The vendor's side starts a discovery server", "The laptop joins the robot over the cable"} <= set(changed(first))
    assert 'ROS_DISCOVERY_SERVER="10.42.0.1:11811"' in (home / ".config/lupin/ros-env.sh").read_text()
    assert listens(targets)
    assert changed(play("demo-wired", targets, given)) == []
    back = undo(find_run(first.run), targets)
    assert back.state == "done", back.message
    assert not (home / ".config/lupin/ros-env.sh").exists()
    assert (home / ".bashrc").read_text() == "source /opt/ros/humble/setup.bash\n"
    assert targets["robot"].run("cat ~/.mirte_settings.sh").stdout == "export MIRTE_FASTDDS=false\n"


def test_the_access_point_demo_brings_it_back(fresh_host: Host, home: Path, targets: dict[str, Any]) -> None:
    targets["robot"].run("systemctl disable --now mirte-wifi-watchdog mirte-ap", root=True)
    assert "The access point is on" in changed(play("demo-access-point", targets, dry_run=True))
    first = play("demo-access-point", targets)
    assert {"The access point is on", "The laptop joins the robot over its access point"} <= set(changed(first))
    assert changed(play("demo-access-point", targets)) == []
    assert undo(find_run(first.run), targets).state == "done"
    assert targets["robot"].run("systemctl is-enabled mirte-ap").stdout.strip() == "disabled"


def test_a_robot_without_networkmanager_cannot_join_a_router_and_nothing_was_changed(targets: dict[str, Any]) -> None:
    result = play("demo-router", targets, {"ssid": "travel", "key": "long enough", "robot_ip": "10.0.0.7"})
    assert result.state == "failed" and "NetworkManager does not run there" in result.message
    assert result.changed == 0


def test_a_cable_pulled_in_the_middle_is_resumed_when_it_is_back(
    fresh_host: Host, targets: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lupin_cli.target.reach.UNACKNOWLEDGED_MS", 500)

    def pull(event: Any) -> None:
        if event.kind == "step" and event.step == "The boot-time unit is there":
            fresh_host.robot.fault("cable-cut", link="eth0")

    result = play("install-clock-sync", targets, {"laptop_serves": False}, on_event=pull)
    assert (result.state, result.exit_code) == ("unreachable", 3), result.message
    fresh_host.robot.mend("cable-cut", link="eth0")
    targets["robot"].close()
    fresh_host.robot.wait_ready()
    again = play("install-clock-sync", targets, resume=True)
    assert (again.state, again.run) == ("done", result.run), again.message
    assert targets["robot"].run("systemctl is-enabled lupin-clock-sync").stdout.strip() == "enabled"


def test_a_computer_becomes_a_robots_laptop_and_is_one_no_more(fresh_host: Host, home: Path, targets: dict[str, Any]) -> None:
    """The robot's computer stands in for the laptop here: it has a systemd and a chrony that may really be changed."""
    laptop = {"laptop": targets["robot"]}
    serving = "ss -H -lnu 'sport = :123' | wc -l; ls /etc/chrony/conf.d"
    before = targets["robot"].run(serving).stdout
    dry = play("deploy-laptop", laptop, dry_run=True)
    assert dry.changed >= 3 and targets["robot"].run(serving).stdout == before
    first = play("deploy-laptop", laptop)
    assert {"New terminals join the robot's graph", "serve-clock / Chrony may serve the robot"} <= set(changed(first))
    assert int(targets["robot"].run(serving).stdout.split()[0]) >= 1
    script = f". {home}/.config/lupin/ros-env.sh; echo $ROS_DISCOVERY_SERVER; cat {home}/.bashrc"
    assert targets["robot"].run(script).stdout.startswith("10.42.0.1:11811\n# lupin dds")
    assert changed(play("deploy-laptop", laptop)) == []
    removed = play("remove-laptop", laptop)
    assert "Chrony no longer serves the robot" in changed(removed)
    assert targets["robot"].run(serving).stdout == before
    assert changed(play("remove-laptop", laptop)) == []
    assert undo(find_run(removed.run), laptop).state == "done"
    assert changed(play("deploy-laptop", laptop)) == []
    assert undo(find_run(first.run), laptop).state == "done"
    assert targets["robot"].run(f"ls {home}/.config/lupin").stdout == ""


def test_every_playbook_that_needs_no_release_shows_what_it_would_do_and_changes_nothing(
    fresh_host: Host, home: Path, targets: dict[str, Any]
) -> None:
    look = "find /etc /usr/local /opt /home -type f | sort | xargs md5sum; systemctl list-unit-files --no-legend"
    before = targets["robot"].run(look, root=True).stdout
    given: dict[str, dict[str, Any]] = {"sweep": {"machine": "robot"}, "install-clock-sync": {"laptop_serves": False}}
    for name in ("recover-discovery", "single-home", "demo-wired", "demo-access-point", "pin-wifi", "sync-clock", "sweep"):
        result = play(name, targets, given.get(name), dry_run=True)
        assert result.state == "done", f"{name}: {result.message}"
    assert targets["robot"].run(look, root=True).stdout == before
    assert list(home.iterdir()) == [home / ".bashrc"]
