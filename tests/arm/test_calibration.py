from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime import graph
from lupin_runtime.arm.calibration import HOME_COUNTS, LARGEST_COUNTS, SMALLEST_COUNTS, find


@given(st.sampled_from(sorted(HOME_COUNTS)), st.integers(-6000, 6000), st.integers(-3000, 3000))
def test_an_offset_is_written_only_where_it_is_worth_it_and_believable(servo, diff, current):
    finding = find(servo, [HOME_COUNTS[servo] + diff], current)
    total = diff + current
    assert finding.diff == diff
    assert finding.offset == (total if SMALLEST_COUNTS < abs(total) <= LARGEST_COUNTS else None)


def test_one_wild_reading_does_not_count():
    home = HOME_COUNTS["wrist"]
    assert find("wrist", [home + 500, home + 501, 65535, home + 499, home + 500], 0).offset == 500


def test_without_readings_nothing_is_found():
    with pytest.raises(ValueError, match="no encoder readings"):
        find("elbow", [], 0)


class Servos:
    """The vendor's servo bus: offsets, positions, gates, and what it was asked in which order."""

    def __init__(self, host) -> None:
        from mirte_msgs.msg import ServoPosition
        from sensor_msgs.msg import JointState

        from lupin_runtime.ros import LupinNode

        self.offsets = dict.fromkeys(HOME_COUNTS, 40)
        self.raw = {servo: home + 1000 for servo, home in HOME_COUNTS.items()}
        self.calls: list[tuple] = []
        self.broken: set[tuple] = set()
        self.node = LupinNode("servos")
        self.node.subscription(graph.ARM_TRAJECTORY, lambda _: self.calls.append(("pin",)))
        self.node.service(graph.VENDOR_TORQUE, self._switch("torque"))
        self.node.service(graph.VENDOR_ARM_GATE, self._switch("gate"))
        publishers = {servo: self.node.publisher(graph.servo_position(servo)) for servo in HOME_COUNTS}
        joints = self.node.publisher(graph.JOINT_STATES)
        for servo in HOME_COUNTS:
            self.node.service(graph.servo_offset(servo), self._get(servo))
            self.node.service(graph.servo_set_offset(servo), self._set(servo))
            self.node.service(graph.servo_set_angle(servo), self._angle(servo))

        def speak() -> None:
            joints.publish(JointState(name=list(graph.ARM_JOINTS), position=[0.0] * 4))
            for servo, publisher in publishers.items():
                publisher.publish(ServoPosition(raw=self.raw[servo]))

        self.node.create_timer(0.02, speak)
        host.add(self.node)

    def _switch(self, name: str):
        def serve(request, response):
            self.calls.append((name, request.data))
            response.success = (name, request.data) not in self.broken
            response.message = "" if response.success else "out of order"
            return response

        return serve

    def _get(self, servo: str):
        def serve(_, response):
            response.centidegrees = self.offsets[servo]
            return response

        return serve

    def _set(self, servo: str):
        def serve(request, response):
            self.offsets[servo] = request.centidegrees
            self.calls.append(("offset", servo, request.centidegrees))
            return response

        return serve

    def _angle(self, servo: str):
        def serve(request, response):
            self.calls.append(("angle", servo, request.angle))
            response.status = ("angle", servo) not in self.broken
            return response

        return serve


@pytest.fixture
def servos(graph_host):
    return Servos(graph_host)


@pytest.fixture
def ask(graph_host, servos, monkeypatch):
    """Calls `/lupin/arm/calibrate` on a server whose waits are short."""
    from lupin_msgs.srv import CalibrateArm

    from lupin_runtime.arm import calibrate_server
    from lupin_runtime.arm.node import ArmCalibrateServer, ArmPresetServer, GripperActionBridge
    from lupin_runtime.ros import LupinNode

    monkeypatch.setattr(calibrate_server, "SETTLE_S", 0.1)
    monkeypatch.setattr(calibrate_server, "SAMPLE_S", 0.3)
    for node in (ArmPresetServer(), GripperActionBridge(), ArmCalibrateServer()):
        graph_host.add(node)
    operator = graph_host.add(LupinNode("operator"))
    clients = {row: operator.client(row) for row in (graph.ARM_CALIBRATE, graph.ARM_PRESET, graph.ARM_SET_TORQUE)}
    graph_host.until(lambda: all(client.service_is_ready() for client in clients.values()), what="the services")
    graph_host.until(lambda: ("pin",) in servos.calls, what="the pin")
    servos.calls.clear()

    def call(request, row=graph.ARM_CALIBRATE):
        future = clients[row].call_async(CalibrateArm.Request(action=request) if isinstance(request, str) else request)
        graph_host.until(future.done, timeout_s=20.0, what="the answer")
        return future.result()

    return call


@pytest.mark.graph
def test_start_makes_the_arm_limp_and_commit_writes_what_it_reads(servos, ask):
    from lupin_msgs.srv import SetArmPreset
    from std_srvs.srv import SetBool

    answer = ask("start")
    assert answer.success and answer.state == "AWAITING_POSE", answer.message
    assert servos.calls[0] == ("gate", False) and servos.calls[-1] == ("torque", False)
    assert set(servos.offsets.values()) == {0}
    # nobody else may stiffen or move it meanwhile
    refused = ask(SetBool.Request(data=True), graph.ARM_SET_TORQUE)
    assert not refused.success and "calibrated" in refused.message
    assert not ask(SetArmPreset.Request(name="home"), graph.ARM_PRESET).success
    assert not ask("start").success

    servos.raw["elbow"] = HOME_COUNTS["elbow"] + 100
    servos.raw["wrist"] = HOME_COUNTS["wrist"] - 4000
    servos.calls.clear()
    answer = ask("commit")
    assert answer.success and answer.state == "IDLE", answer.message
    assert list(answer.joint_names) == list(HOME_COUNTS)
    assert list(answer.offsets_applied) == [1000, 0, 0, 1000]
    assert list(answer.diffs_observed) == [1000, 100, -4000, 1000]
    assert servos.offsets == {"shoulder_lift": 1000, "elbow": 0, "wrist": 0, "gripper": 1000}
    kinds = [call[0] for call in servos.calls]
    assert kinds == ["offset", "offset", "torque", "angle", "angle", "pin", "gate"]
    assert "assembled wrongly" in answer.message
    assert ask(SetArmPreset.Request(name="home"), graph.ARM_PRESET).success


@pytest.mark.graph
def test_cancel_writes_the_old_offsets_back_and_is_no_error_when_idle(servos, ask):
    assert ask("cancel").success
    assert servos.calls == []
    assert ask("start").success
    answer = ask("cancel")
    assert answer.success and answer.state == "IDLE", answer.message
    assert set(servos.offsets.values()) == {40}
    assert servos.calls[-1] == ("gate", True)
    assert not ask("commit").success, "nothing to commit"
    assert ask("status").message == "no calibration is under way"
    assert not ask("dance").success


@pytest.mark.graph
def test_a_start_that_fails_gives_the_arm_back_as_it_was(servos, ask):
    servos.broken = {("angle", "wrist")}
    answer = ask("start")
    assert not answer.success and answer.state == "IDLE" and "wrist" in answer.message
    assert set(servos.offsets.values()) == {40}
    assert ("torque", True) in servos.calls and servos.calls[-1] == ("gate", True)
