"""Jogging on a real graph: from rates or a gamepad to the arm's trajectories, and what the status says of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.arm.jog import RELEASE_FIRST, STOP_LEAD_RAD
from lupin_runtime.teleop.events import BTN_EAST, BTN_TL
from tests.support import pad_ids
from tests.support.arm_vendor import arm_nodes
from tests.support.fake_pads import FakePads
from tests.support.pad_events import key
from tests.support.waiting import wait_for_nothing

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

PAN = {"shoulder_pan_joint": 1.0}


class Rig:
    """The arm's nodes with jog and monitor, a source of rates, and the status."""

    def __init__(self, host: GraphHost, vendor: Any, console: Any) -> None:
        from lupin_runtime.arm.monitor_node import ArmMonitor
        from lupin_runtime.arm.teleop_node import ArmTeleop

        self.host, self.vendor, self.console = host, vendor, console
        self.follows = True
        self.statuses: list[dict[str, Any]] = []
        nodes = arm_nodes(host, pinned_by=vendor)
        self.motion = nodes[0].motion
        console.node.subscription(graph.ARM_STATUS, lambda message: self.statuses.append(json.loads(message.data)))
        console.node.subscription(graph.ARM_TRAJECTORY, self._follow)
        self._publisher = console.node.publisher(graph.ARM_JOG)
        for node in (ArmTeleop(), ArmMonitor()):
            host.add(node)
        host.until(lambda: self._publisher.get_subscription_count() > 0, what="the jog's subscription")
        host.until(lambda: self.statuses, what="the arm's status")

    def _follow(self, message: Any) -> None:
        if self.follows:
            self.vendor.at = list(message.points[-1].positions)

    def publish(self, rates: dict[str, float] | None = None, source: str = "a pad") -> None:
        from sensor_msgs.msg import JointState

        message = JointState(name=list(rates or {}), velocity=list((rates or {}).values()))
        message.header.frame_id = source
        self._publisher.publish(message)

    def jog(self, rates: dict[str, float] | None = None) -> None:
        """Jog from rest until the arm is reserved by it."""
        self.publish()

        def step() -> bool:
            self.publish(rates or PAN)
            wait_for_nothing(0.02, "the next message of a stream")
            return bool(self.status["jogged_by"])

        self.host.until(step, what="the jog")

    @property
    def status(self) -> dict[str, Any]:
        return self.statuses[-1]


@pytest.fixture
def rig(graph_host: GraphHost, vendor: Any, console: Any) -> Rig:
    return Rig(graph_host, vendor, console)


def test_rates_move_the_joint_until_they_are_zero(rig: Rig) -> None:
    rig.jog()
    rig.host.until(lambda: rig.vendor.last[0] > 0.12, what="the pan")
    assert rig.vendor.last[1:] == (0.2, 0.3, -0.4)
    assert rig.status["holder"] == "jogging"
    rig.publish()
    rig.host.until(lambda: not rig.status["holder"], what="the release of the arm")
    assert rig.status["jog_refusal"] == ""


def test_preset_is_refused_while_the_arm_is_jogged(rig: Rig) -> None:
    rig.jog()
    answer = rig.console.ask(graph.ARM_PRESET, name="home")
    assert not answer.success
    assert "reserved: jogging" in answer.message


def test_stop_service_ends_a_jog_that_goes_on(rig: Rig, graph_host: GraphHost, tmp_path: Path) -> None:
    from lupin_runtime.arm.node import ArmLibraryServer

    graph_host.add(ArmLibraryServer({"library_path": str(tmp_path / "arm_library.json")}))
    rig.jog()
    assert rig.console.ask(graph.ARM_LIBRARY_STOP).success
    rig.publish(PAN)
    rig.host.until(lambda: RELEASE_FIRST in rig.status["jog_refusal"], what="the refusal")
    assert not rig.status["holder"]


def test_jog_during_a_replay_is_refused_by_its_name(rig: Rig) -> None:
    rig.motion.hold("playing wave")
    rig.publish()
    rig.publish(PAN)
    rig.host.until(lambda: "playing wave" in rig.status["jog_refusal"], what="the refusal")
    assert len(rig.vendor.trajectories) == 1


def test_silence_ends_the_jog(rig: Rig) -> None:
    rig.jog()
    rig.host.until_expired(lambda: "nothing was heard" in rig.status["jog_refusal"], "the end of a silent jog")
    assert not rig.status["holder"]


def test_blocked_joint_is_named_and_ends_its_jog(rig: Rig) -> None:
    rig.follows = False
    rig.publish()

    def step() -> bool:
        rig.publish(PAN)
        wait_for_nothing(0.02, "the next message of a stream")
        return bool(rig.status["blocked"])

    rig.host.until_expired(step, "the blocked joint")
    assert rig.status["blocked"] == ["shoulder_pan_joint"]
    assert "shoulder_pan does not follow" in rig.status["alarms"][0]
    rig.host.until(lambda: "shoulder_pan_joint does not follow" in rig.status["jog_refusal"], what="the end of the jog")
    assert abs(rig.vendor.last[0] - 0.1) <= STOP_LEAD_RAD + 1e-6


def test_gripper_is_jogged_by_its_action(rig: Rig) -> None:
    rig.jog({"gripper_joint": 0.4})
    rig.host.until(lambda: rig.vendor.gripper_goals, what="the goal")
    assert 0.0 < rig.vendor.gripper_goals[0][0] <= 0.25
    rig.host.until(lambda: len(rig.vendor.trajectories) == 2, what="the pose in which the arm is held")
    assert rig.vendor.last[1:] == (0.2, 0.3, -0.4)


def test_refused_command_of_the_gripper_is_published(rig: Rig) -> None:
    rig.host.within(rig.vendor.node, rig.vendor.deactivate_gripper)
    rig.jog({"gripper_joint": 0.4})

    def step() -> bool:
        rig.publish({"gripper_joint": 0.4})
        wait_for_nothing(0.02, "the next message of a stream")
        return "the gripper does not move" in rig.status["jog_refusal"]

    rig.host.until_expired(step, "the refusal")
    assert "lupin home" in rig.status["jog_refusal"] and rig.status["jogged_by"] == "a pad", "joints can still be jogged"
    rig.publish()
    rig.host.until(lambda: not rig.status["jog_refusal"], what="the end of the refusal")


@pytest.mark.parametrize(
    ("names", "rates"), [(["elbow_joint"], []), (["tail"], [1.0]), (["elbow_joint"] * 2, [1.0] * 2), (["elbow_joint"], [1e999])]
)
def test_malformed_rates_move_nothing(rig: Rig, names: list[str], rates: list[float]) -> None:
    from sensor_msgs.msg import JointState

    rig.publish()
    rig._publisher.publish(JointState(name=names, velocity=rates))
    rig.jog()
    assert rig.vendor.last[1:] == (0.2, 0.3, -0.4)


def test_gamepad_jogs_the_arm_and_its_loss_ends_that(rig: Rig, tmp_path: Path) -> None:
    from lupin_runtime.teleop.node import PadTeleop

    pads = FakePads(tmp_path)
    folders = {"devices": pads.devices, "sysfs": pads.sysfs, "maps": pads.maps}
    node = rig.host.add(PadTeleop({name: str(folder) for name, folder in folders.items()}))
    pads.plug("event5", pad_ids.XBOX_USB)

    def press() -> bool:
        for code, value in ((BTN_TL, 0), (BTN_EAST, 0), (BTN_EAST, 1)):
            pads.send("event5", key(code, value, node.monotonic_ns()))
            wait_for_nothing(0.03, "the node to read it")
        return bool(rig.status["jogged_by"])

    rig.host.until_expired(press, "the jog by the pad")
    assert rig.status["jogged_by"].startswith("the gamepad of ")
    pads.unplug("event5")
    rig.host.until(lambda: not rig.status["holder"], what="the end of the jog")
    count = len(rig.vendor.trajectories)
    wait_for_nothing(0.3, "trajectories of a pad that is gone")
    assert len(rig.vendor.trajectories) == count
    pads.close()
