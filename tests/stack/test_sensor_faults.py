"""One mission during which the robot's sensors and its clock break one after another, while it drives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

from lupin_runtime import graph

pytestmark = [pytest.mark.mission, pytest.mark.sim, pytest.mark.graph]

MISSION_BOUND_S = 900.0
LOOK_S = 4.0
DRIVING_M_S, AT_REST_M_S = 0.1, 0.005


@dataclass(frozen=True)
class Trouble:
    """What breaks, whether the robot has to stand still until it is mended, and who says so in which words."""

    order: str
    stands: bool
    by: str
    says: str


TROUBLES = (
    Trouble("scan nan", True, "nav", "beams measure anything"),
    Trouble("scan frozen", True, "nav", "the lidar is frozen"),
    Trouble("scan silent", True, "nav", "nothing comes on /scan"),
    Trouble("camera silent", False, "perception", "no picture"),
    Trouble("odometry silent", True, "nav", "no recent transform odom -> base_link"),
    Trouble("clock 20", False, "", ""),
    Trouble("clock -20", False, "slam", "buffers are cleared, the map is kept"),
)


def stays_at_rest(run: Any, words: int = 2) -> None:
    """The simulator says so often that the robot does not move."""
    for _ in range(words):
        then = run.simulator()["sim_time_s"]
        run.wait(lambda then=then: run.simulator()["sim_time_s"] > then, "word of the simulator")
        assert run.speed_m_s() < AT_REST_M_S, run.simulator()


def survive(run: Any, break_it: Callable[[str], None], trouble: Trouble) -> None:
    """Break something under the driving robot, see what it does, and mend it."""
    run.wait(lambda: run.speed_m_s() > DRIVING_M_S, f"driving before {trouble.order}")
    before = run.log(trouble.by).count(trouble.says)
    break_it(trouble.order)
    if trouble.says:
        run.wait(lambda: run.log(trouble.by).count(trouble.says) > before, f"word of {trouble.order}", 60.0)
    if trouble.stands:
        run.wait(lambda: run.speed_m_s() < AT_REST_M_S, f"standing still under {trouble.order}", 30.0)
        stays_at_rest(run)
    else:
        seen = run.simulator()["sim_time_s"]
        run.wait(lambda: run.simulator()["sim_time_s"] > seen + LOOK_S, f"{LOOK_S:.0f} s under {trouble.order}")
    assert run.simulator()["collisions"] == 0, trouble.order
    if not trouble.order.startswith("clock"):
        break_it(f"{trouble.order.split()[0]} none")


def test_a_mission_outlives_every_sensor_and_a_clock_that_jumps(launch: Callable[..., Any], join: Callable[..., Any]) -> None:
    from std_msgs.msg import String

    run = launch("--mission", "--headless", "--json", "--world", "walled")
    run.until(lambda state: state["mission"].get("lifecycle_state") == "EXPLORING", "exploration")
    order = join(run).publisher(graph.SIM_FAULT)
    for trouble in TROUBLES:
        survive(run, lambda text: order(String(data=text)), trouble)
    # Dark until navigation gives the goal up: no reason to call a tag unreachable.
    run.until(lambda state: state["mission"]["lifecycle_state"] == "MONITORING", "sweep", 300.0)
    run.wait(lambda: run.speed_m_s() > DRIVING_M_S, "driving to a tag")
    order(String(data="scan zero"))
    run.until(lambda state: state["mission"]["last_error"] == "nav_blind", "word of the darkness")
    assert "navigation aborted, SENSOR_LOST" in run.log("nav")
    stays_at_rest(run)
    order(String(data="scan none"))
    status, result = run.result(MISSION_BOUND_S)
    assert (status, result["state"]) == (0, "DONE"), result
    assert result["tags_read"] == result["tags_reachable"] == result["tags_total"] - 1
    assert result["collisions"] == 0
