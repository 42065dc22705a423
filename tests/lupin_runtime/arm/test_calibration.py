"""Calibration of servo offsets: robust against outliers, and undone if it is cancelled or fails."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime import graph
from lupin_runtime.arm.calibration import HOME_COUNTS, MAX_COUNTS, MIN_COUNTS, find_offset
from tests.support.servo_vendor import Servos

if TYPE_CHECKING:
    from lupin_msgs.srv import CalibrateArm_Response, SetArmPreset_Response
    from std_srvs.srv import SetBool_Response

    from lupin_runtime.graph import Service
    from tests.conftest import GraphHost


@given(st.sampled_from(sorted(HOME_COUNTS)), st.integers(-6000, 6000), st.integers(-3000, 3000))
def test_offset_is_written_only_in_the_plausible_range(servo: str, diff: int, current: int) -> None:
    finding = find_offset(servo, [HOME_COUNTS[servo] + diff], current)
    total = diff + current
    assert finding.diff == diff
    assert finding.offset == (total if MIN_COUNTS < abs(total) <= MAX_COUNTS else None)


def test_one_outlier_does_not_change_the_offset() -> None:
    home = HOME_COUNTS["wrist"]
    assert find_offset("wrist", [home + 500, home + 501, 65535, home + 499, home + 500], 0).offset == 500


def test_offset_without_readings_is_refused() -> None:
    with pytest.raises(ValueError, match="no encoder readings"):
        find_offset("elbow", [], 0)


@pytest.fixture
def servos(graph_host: GraphHost) -> Any:
    return Servos(graph_host)


@pytest.fixture
def ask(graph_host: GraphHost, servos: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Call `/lupin/arm/calibrate` on a server with short waits."""
    from lupin_msgs.srv import CalibrateArm

    from lupin_runtime.arm import calibrate_server
    from lupin_runtime.arm.node import ArmCalibrateServer, ArmPresetServer, GripperActionBridge
    from lupin_runtime.ros import LupinNode

    monkeypatch.setattr(calibrate_server, "SETTLE_S", 0.1)
    monkeypatch.setattr(calibrate_server, "SAMPLE_S", 0.3)
    for node in (ArmPresetServer(), GripperActionBridge(), ArmCalibrateServer()):
        graph_host.add(node)
        node.motion.set_estop(False)
    operator = graph_host.add(LupinNode("operator"))
    clients = {row: operator.client(row) for row in (graph.ARM_CALIBRATE, graph.ARM_PRESET, graph.ARM_SET_TORQUE)}
    graph_host.until(lambda: all(client.service_is_ready() for client in clients.values()), what="the services")
    graph_host.until(lambda: ("pin",) in servos.calls, what="the servos to be pinned")
    servos.calls.clear()

    def call(
        request: pytest.FixtureRequest, row: Service = graph.ARM_CALIBRATE
    ) -> CalibrateArm_Response | SetArmPreset_Response | SetBool_Response:
        future = clients[row].call_async(CalibrateArm.Request(action=request) if isinstance(request, str) else request)
        graph_host.until(future.done, what="the answer")
        return future.result()

    return call


@pytest.mark.graph
def test_calibration_starts_limp_and_commits_the_readings(servos: Any, ask: Callable[..., Any]) -> None:
    from lupin_msgs.srv import SetArmPreset
    from std_srvs.srv import SetBool

    answer = ask("start")
    assert answer.success and answer.state == "AWAITING_POSE", answer.message
    assert servos.calls[0] == ("gate", False) and servos.calls[-1] == ("torque", False)
    assert set(servos.offsets.values()) == {0}
    # torque and motion are refused meanwhile
    refused = ask(SetBool.Request(data=True), graph.ARM_SET_TORQUE)
    assert not refused.success and "calibration is in progress" in refused.message
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
def test_cancelled_calibration_restores_the_offsets(servos: Any, ask: Callable[..., Any]) -> None:
    assert ask("cancel").success
    assert servos.calls == []
    assert ask("start").success
    answer = ask("cancel")
    assert answer.success and answer.state == "IDLE", answer.message
    assert set(servos.offsets.values()) == {40}
    assert servos.calls[-1] == ("gate", True)
    assert not ask("commit").success, "nothing to commit"
    assert ask("status").message == "no calibration is in progress"
    assert not ask("dance").success


@pytest.mark.graph
def test_failed_calibration_start_restores_the_arm(servos: Any, ask: Callable[..., Any]) -> None:
    servos.broken = {("angle", "wrist")}
    answer = ask("start")
    assert not answer.success and answer.state == "IDLE" and "wrist" in answer.message
    assert set(servos.offsets.values()) == {40}
    assert ("torque", True) in servos.calls and servos.calls[-1] == ("gate", True)
