"""A mission during which the robot's sensors and its clock fail one after another while it drives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from lupin_runtime import graph

pytestmark = [pytest.mark.mission, pytest.mark.sim, pytest.mark.graph]

MISSION_TIMEOUT_S = 900.0
LOOK_S = 4.0
DRIVING_M_S, AT_REST_M_S = 0.1, 0.005


@dataclass(frozen=True)
class SensorFault:
    """A fault, whether the robot must stop until it is cleared, and the process that logs it with its message."""

    order: str
    stops: bool
    process: str
    message: str


SENSOR_FAULTS = (
    SensorFault("scan nan", True, "nav", "beams measure"),
    SensorFault("scan frozen", True, "nav", "the lidar is frozen"),
    SensorFault("scan silent", True, "nav", "no message arrives on /scan"),
    SensorFault("camera silent", False, "perception", "no image"),
    SensorFault("odometry silent", True, "nav", "no recent transform odom -> base_link"),
    SensorFault("clock 20", False, "", ""),
    SensorFault("clock -20", False, "slam", "buffers are cleared, the map is kept"),
)


def stays_at_rest(run: Any, states: int = 2) -> None:
    """Check in several states of the simulator that the robot does not move."""
    for _ in range(states):
        then = run.simulator()["sim_time_s"]
        run.wait(lambda then=then: run.simulator()["sim_time_s"] > then, "word of the simulator")
        assert run.speed_m_s() < AT_REST_M_S, run.simulator()


def survive(run: Any, inject: Callable[[str], None], fault: SensorFault) -> None:
    """Inject a fault while the robot drives, check its reaction, and clear the fault."""
    run.wait(lambda: run.speed_m_s() > DRIVING_M_S, f"driving before {fault.order}")
    before = run.log(fault.process).count(fault.message)
    inject(fault.order)
    if fault.message:
        run.wait(lambda: run.log(fault.process).count(fault.message) > before, f"word of {fault.order}")
    if fault.stops:
        run.wait(lambda: run.speed_m_s() < AT_REST_M_S, f"standing still under {fault.order}")
        stays_at_rest(run)
    else:
        seen = run.simulator()["sim_time_s"]
        run.wait(lambda: run.simulator()["sim_time_s"] > seen + LOOK_S, f"{LOOK_S:.0f} s under {fault.order}")
    assert run.simulator()["collisions"] == 0, fault.order
    if not fault.order.startswith("clock"):
        inject(f"{fault.order.split()[0]} none")


def test_mission_survives_sensor_faults_and_clock_jumps(launch: Callable[..., Any], join: Callable[..., Any]) -> None:
    from std_msgs.msg import String

    run = launch("--mission", "--headless", "--json", "--world", "walled")
    run.until(lambda state: state["mission"].get("lifecycle_state") == "EXPLORING", "exploration")
    order = join(run).publisher(graph.SIM_FAULT).publish
    for fault in SENSOR_FAULTS:
        survive(run, lambda text: order(String(data=text)), fault)
    # The lidar is blind until navigation gives up the goal: the tag must not count as unreachable.
    run.until(lambda state: state["mission"]["lifecycle_state"] == "MONITORING", "monitoring", 300.0)
    run.wait(lambda: run.speed_m_s() > DRIVING_M_S, "driving to a tag")
    order(String(data="scan zero"))
    run.until(lambda state: state["mission"]["last_error"] == "nav_blind", "word of the darkness")
    assert "navigation aborted, SENSOR_LOST" in run.log("nav")
    stays_at_rest(run)
    order(String(data="scan none"))
    status, result = run.result(MISSION_TIMEOUT_S)
    assert (status, result["state"]) == (0, "DONE"), result
    assert result["tags_read"] == result["tags_reachable"] == result["tags_total"] - 1
    assert result["collisions"] == 0
