"""`lupin home --when-idle` waits for the arm's users, on a real graph."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from tests.lupin_runtime.arm.test_auto_home import SHORT, Manager

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


class Rig:
    """An auto-home that waits until the arm is idle, and an arm whose status the test chooses."""

    def __init__(self, host: GraphHost, idle_s: float) -> None:
        from std_msgs.msg import String

        from lupin_runtime.arm.auto_home import AutoHome, Limits
        from lupin_runtime.ros import LupinNode

        self.manager = Manager(host, dict.fromkeys(graph.CONTROLLERS, "active"))
        self.status: dict[str, Any] = {"holder": "", "moving": False, "limp": False}
        publisher = self.manager.node.publisher(graph.ARM_STATUS)
        self.manager.node.create_timer(0.1, lambda: publisher.publish(String(data=json.dumps(self.status))))
        self.lines: list[str] = []
        self.node = LupinNode("auto_home")
        self.home = AutoHome(self.node, Limits(**SHORT, idle_s=idle_s), self._say)

    def _say(self, line: str) -> None:
        self.lines.append(line)
        if "reserved" in line:
            self.status = {**self.status, "holder": ""}  # the jog ends as soon as it is noticed

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


def test_arm_that_is_not_idle_in_time_is_left_alone(graph_host: GraphHost) -> None:
    from lupin_runtime.arm.auto_home import NotHome

    rig = Rig(graph_host, idle_s=0.5)
    rig.status["moving"] = True
    with graph_host.clock.real(), pytest.raises(NotHome, match=r"not idle within 0\.5 s: it moves"):
        rig.home.run()
    assert rig.manager.presets == []
    rig.close()
