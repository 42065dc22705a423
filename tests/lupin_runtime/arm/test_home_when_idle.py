"""The arm is not sent home while somebody uses it, on a real graph; `lupin home --when-idle` waits for the end of that."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph, home_report
from lupin_runtime.exit_codes import ESTOPPED, FAILURE
from tests.lupin_runtime.arm.test_auto_home import SHORT, Manager

if TYPE_CHECKING:
    from pathlib import Path

    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


class Rig:
    """An auto-home that waits until the arm is idle, and an arm whose status the test chooses."""

    def __init__(self, host: GraphHost, idle_s: float) -> None:
        from lupin_msgs.msg import MissionState
        from std_msgs.msg import String

        from lupin_runtime.arm.auto_home import AutoHome, Limits
        from lupin_runtime.ros import LupinNode

        self.manager = Manager(host, dict.fromkeys(graph.CONTROLLERS, "active"))
        self.status: dict[str, Any] = {"holder": "", "moving": False, "limp": False}
        publisher = self.manager.node.publisher(graph.ARM_STATUS)
        self.manager.node.create_timer(0.1, lambda: publisher.publish(String(data=json.dumps(self.status))))
        mission = self.manager.node.publisher(graph.MISSION_STATE)
        self.manager.node.create_timer(0.1, lambda: mission.publish(MissionState(lifecycle_state="READY")))
        self.lines: list[str] = []
        self.node = LupinNode("auto_home")
        self.home = AutoHome(self.node, Limits(**SHORT, idle_s=idle_s), self._say)

    def _say(self, line: str) -> None:
        self.lines.append(line)
        if "reserved" in line:
            self.status = {**self.status, "holder": ""}  # the jog ends as soon as it is noticed

    def use_while_it_settles(self) -> None:
        """Jog the arm once, after it was found idle."""
        spin_for, used = self.home._spin_for, False

        def settle(duration_s: float) -> None:
            nonlocal used
            if not used:
                used, self.status = True, {**self.status, "holder": "jogging"}
            spin_for(duration_s + 0.5 * used)

        self.home._spin_for = settle  # type: ignore[method-assign]

    def close(self) -> None:
        self.home.close()
        self.node.destroy_node()


def test_arm_is_sent_home_after_the_jog_has_ended(graph_host: GraphHost) -> None:
    rig = Rig(graph_host, idle_s=30.0)
    rig.status["holder"] = "jogging"
    with graph_host.clock.real():
        rig.home.run()
    assert "waiting until the arm is idle: it is reserved: jogging" in rig.lines
    assert rig.manager.presets == ["home"]
    rig.close()


def test_arm_that_is_used_just_before_it_moves_is_waited_for(graph_host: GraphHost) -> None:
    rig = Rig(graph_host, idle_s=30.0)
    rig.use_while_it_settles()
    with graph_host.clock.real():
        rig.home.run()
    assert "waiting until the arm is idle: it is reserved: jogging" in rig.lines
    assert rig.manager.presets == ["home"]
    rig.close()


def test_arm_that_is_not_idle_in_time_is_left_alone(graph_host: GraphHost) -> None:
    from lupin_runtime.arm.auto_home import NotHome

    rig = Rig(graph_host, idle_s=0.5)
    rig.status["moving"] = True
    with graph_host.clock.real(), pytest.raises(NotHome, match=r"not idle within 0\.5 s: it moves"):
        rig.home.run()
    assert rig.manager.presets == []
    rig.close()


def test_arm_that_somebody_has_reserved_is_left_alone(graph_host: GraphHost) -> None:
    from lupin_runtime.arm.auto_home import AutoHome, LeftAlone, Limits
    from lupin_runtime.ros import LupinNode

    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    manager.refusals, manager.refusal = 1, "the arm is reserved: jogging; stop that with /lupin/arm/library/stop"
    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(**SHORT), say=lambda _: None)
    with pytest.raises(LeftAlone, match="jogging"):
        home.run()
    assert manager.presets == ["home"]
    home.close()
    node.destroy_node()


def test_motion_is_announced_only_while_it_is_about_to_begin(
    graph_host: GraphHost, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    home_report.write_report(home_report.FAILED, "no controller")
    rig = Rig(graph_host, idle_s=30.0)
    written: list[str] = []
    monkeypatch.setattr(home_report, "write_report", lambda state, _="": written.append(state))
    rig.use_while_it_settles()
    with graph_host.clock.real():
        rig.home.run()
    again = written[written.index(home_report.HOMING) :]
    assert again == [home_report.HOMING, home_report.FAILED, home_report.HOMING], "still unsolved while somebody uses the arm"
    rig.close()


@pytest.mark.parametrize("before", [home_report.FAILED, home_report.ESTOPPED, home_report.HOME])
def test_arm_that_is_left_alone_hides_no_earlier_failure(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, before: str) -> None:
    from lupin_runtime.arm import auto_home

    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    auto_home._report_failure(auto_home.LeftAlone("it jogs"), False, home_report.HomeReport(before, "no controller"))
    found = home_report.read_report(tmp_path)
    expected = (home_report.OFF, "it jogs") if before == home_report.HOME else (before, "no controller")
    assert found is not None and (found.state, found.reason) == expected


@pytest.mark.parametrize(
    ("reason", "unattended", "status", "report"),
    [
        ("LeftAlone", True, ESTOPPED, home_report.OFF),  # systemd does not try again
        ("LeftAlone", False, FAILURE, home_report.OFF),
        ("Estopped", True, ESTOPPED, home_report.ESTOPPED),
        ("NotHome", True, FAILURE, home_report.RETRYING),
        ("NotHome", False, FAILURE, home_report.FAILED),
    ],
)
def test_failure_is_reported_to_the_lights_and_systemd(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, reason: str, unattended: bool, status: int, report: str
) -> None:
    from lupin_runtime.arm import auto_home

    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    assert auto_home._report_failure(getattr(auto_home, reason)("it jogs"), unattended) == status
    found = home_report.read_report(tmp_path)
    assert found is not None and (found.state, found.reason) == (report, "it jogs")
