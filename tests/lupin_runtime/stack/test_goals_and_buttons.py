"""Unreachable goals, saved maps, and the red button in every state of the mission, in a simulated run."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime import graph
from lupin_runtime.mission.hsm_spec import build_hsm_spec

pytestmark = [pytest.mark.mission, pytest.mark.sim, pytest.mark.graph]

AT_REST_M_S = 0.005
SUCCEEDED, ABORTED = 4, 6


def pose_message(x: float, y: float) -> Any:
    from geometry_msgs.msg import PoseStamped

    message = PoseStamped()
    message.header.frame_id = graph.MAP_FRAME
    message.pose.position.x, message.pose.position.y, message.pose.orientation.w = x, y, 1.0
    return message


def stays_at_rest(run: Any, states: int = 2) -> None:
    """Check in several states of the simulator that the robot does not move."""
    for _ in range(states):
        then = run.simulator()["sim_time_s"]
        run.wait(lambda then=then: run.simulator()["sim_time_s"] > then, "word of the simulator")
        assert run.speed_m_s() < AT_REST_M_S, run.simulator()


class Goals:
    """A client of navigate_to_pose that also records the commands at the drive sink."""

    def __init__(self, observer: Any) -> None:
        from nav2_msgs.action import NavigateToPose

        self._observer, self._type = observer, NavigateToPose
        self._client = observer.node.action_client(graph.NAVIGATE_TO_POSE)
        self.fastest = 0.0
        self.drive_messages = 0
        observer.node.subscription(graph.CMD_VEL_SINK_SIM, self._take)
        observer.until(self._client.server_is_ready, "navigation")

    def _take(self, twist: Any) -> None:
        self.drive_messages += 1
        speeds = (twist.linear.x, twist.linear.y, twist.angular.z)
        self.fastest = max(self.fastest, *map(abs, speeds))

    def go(self, x: float, y: float, timeout_s: float = 90.0) -> Any:
        """Drive to a point of the map; return the result, or None if the goal was rejected."""
        sent = self._observer.within(lambda: self._client.send_goal_async(self._type.Goal(pose=pose_message(x, y))))
        handle = self._observer.until(lambda: sent.done() and sent.result(), "answer to the goal")
        if not handle.accepted:
            return None
        result = self._observer.within(handle.get_result_async)
        return self._observer.until(lambda: result.done() and result.result(), "end of the drive", timeout_s)


def test_goal_in_a_wall_is_refused_and_the_next_succeeds(launch: Callable[..., Any], join: Callable[..., Any]) -> None:
    run = launch("--headless", "--json", "--world", "walled", "--no-twin", "--no-perception", "--no-record", "--no-cameras")
    run.wait_up()
    observer = join(run)
    goals = Goals(observer)
    start = run.wait(lambda: run.simulator().get("pose"), "word of the simulator")
    # The map's origin is the robot's start, 0.8 m from the wall behind it.
    ended = goals.go(-2.5, 0.0)
    assert ended.status == ABORTED
    assert "goal" in ended.result.error_msg.lower(), ended.result.error_msg
    assert ended.result.error_code != 0
    refusals = run.log("nav").count("navigation aborted")
    click = observer.publisher(graph.GOAL_POSE).publish
    click(pose_message(-2.5, 0.5))
    run.wait(lambda: run.log("nav").count("navigation aborted") > refusals, "refusal of the click")
    click(pose_message(math.nan, 0.0))
    run.wait(lambda: f"{graph.GOAL_POSE.name} refused" in run.log("nav"), "refusal of a place that is none")
    assert goals.fastest == 0.0
    pose = run.simulator()["pose"]
    assert math.hypot(pose["x"] - start["x"], pose["y"] - start["y"]) < 0.01
    assert goals.go(0.8, 0.0).status == SUCCEEDED
    # A goal in the wall is replaced by the nearest free point within the planner's tolerance, as in Nav2, and logged.
    assert goals.go(0.8, -0.82).status == SUCCEEDED
    assert "the goal is not free (0.80, -0.82)" in run.log("nav")
    assert goals.fastest > 0.05
    assert run.simulator()["collisions"] == 0
    run.process.send_signal(signal.SIGINT)
    assert run.result()[0] == 130


@pytest.fixture
def save_start(launch: Callable[..., Any], join: Callable[..., Any], tmp_path: Path) -> Callable[..., str]:
    """Save the map of a run that has not moved, of what is in view from the start; return its file."""
    from slam_toolbox.srv import SaveMap
    from std_msgs.msg import String

    def save(*arguments: str) -> str:
        mapping = launch("--no-nav2", *arguments)
        mapping.wait_up()
        saved = join(mapping).call(graph.SLAM_SAVE_MAP, name=String(data=str(tmp_path / "start")))
        assert saved.result == SaveMap.Response.RESULT_SUCCESS
        mapping.process.send_signal(signal.SIGINT)
        assert mapping.result()[0] == 130
        return str(tmp_path / "start.yaml")

    return save


def test_saved_map_is_driven_on(launch: Callable[..., Any], join: Callable[..., Any], save_start: Callable[..., str]) -> None:
    from lupin_runtime.ros import TransformListener

    bare = ("--headless", "--json", "--world", "walled", "--no-twin", "--no-perception", "--no-record", "--no-cameras")
    run = launch("--map", save_start(*bare), *bare)
    run.wait_up()
    start = run.wait(lambda: run.simulator().get("pose"), "word of the simulator")
    observer = join(run)
    tree = TransformListener(observer.node).tree
    assert Goals(observer).go(1.0, 0.2).status == SUCCEEDED
    run.wait(lambda: run.speed_m_s() < AT_REST_M_S, "rest at the goal")
    stays_at_rest(run)
    believed, truth = tree.lookup(graph.MAP_FRAME, graph.BASE_FRAME).translation, run.simulator()["pose"]
    assert math.hypot(believed[0] - (truth["x"] - start["x"]), believed[1] - (truth["y"] - start["y"])) < 0.1
    assert run.simulator()["collisions"] == 0
    run.process.send_signal(signal.SIGINT)
    assert run.result()[0] == 130


class Buttons:
    """The red button of a running stack, and the state of its mission."""

    def __init__(self, run: Any, observer: Any) -> None:
        self.run, self.observer = run, observer
        self.mission: Any = None
        self.reached: set[str] = set()
        self.pressed_in: set[str] = set()
        observer.node.subscription(graph.MISSION_STATE, self._take)

    def _take(self, message: Any) -> None:
        self.mission = message
        self.reached.add(self.state)

    @property
    def state(self) -> str:
        """The mission's leaf state."""
        message = self.mission
        if message is None:
            return ""
        return f"{message.lifecycle_state}.{message.mission_phase}" if message.mission_phase else message.lifecycle_state

    def until(self, what: str, condition: Callable[[], Any], timeout_s: float = 90.0) -> None:
        self.observer.until(lambda: self.mission is not None and condition(), f"{what} (last {self.state})", timeout_s)

    def until_state(self, state: str, timeout_s: float = 90.0) -> None:
        self.until(state, lambda: self.state == state, timeout_s)

    def call(self, service: Any) -> Any:
        return self.observer.call(service)

    def start(self, *tags: str, goal: int = 0) -> Any:
        mission_type = "InspectionMission" if tags else "ExplorationMission"
        return self.observer.call(graph.MISSION_START, mission_type=mission_type, discovery_goal=goal, tag_sequence=list(tags))

    def press(self, down: bool) -> None:
        assert self.observer.call(graph.SIM_PRESS_ESTOP, data=down).success
        self.until("word of the e-stop", lambda: self.mission.estop_engaged is down)

    def press_and_release(self, state: str, driving: bool = False, timeout_s: float = 90.0) -> None:
        """Press and release the button in a state; check that nothing moves and the mission stays paused."""
        self.until_state(state, timeout_s)
        if driving:
            self.run.wait(lambda: self.run.speed_m_s() > 0.05 and self.state == state, f"driving in {state}")
        self.press(True)
        stopped_in = self.state
        assert self.mission.paused
        self.run.wait(lambda: self.run.speed_m_s() < AT_REST_M_S, f"rest in {stopped_in}")
        refused = self.call(graph.MISSION_RESUME)
        assert not refused.success and "e-stop" in refused.message
        refused = self.start(goal=1)
        assert not refused.accepted and refused.error_message
        self.press(False)
        stays_at_rest(self.run)
        assert (self.state, self.mission.paused) == (stopped_in, True)
        assert stopped_in == state
        self.pressed_in.add(state)

    def resume(self) -> None:
        answer = self.call(graph.MISSION_RESUME)
        assert answer.success, answer.message


@pytest.fixture
def start_process() -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Start `lupin run PROCESS` in the foreground; it is stopped after the test."""
    made: list[subprocess.Popen[bytes]] = []

    def start(run: Any, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "lupin_cli.app", "run", *arguments]
        with (run.home / f"{arguments[0]}.log").open("wb") as log:
            made.append(subprocess.Popen(command, env=run.environment, stderr=log))
        return made[-1]

    yield start
    for one in made:
        one.terminate()  # its child process exits when its standard input is closed
        one.wait(60)


def test_red_button_stops_every_state_and_release_stays_still(
    launch: Callable[..., Any], join: Callable[..., Any], start_process: Callable[..., Any]
) -> None:
    from std_msgs.msg import String

    run = launch("--headless", "--json", "--world", "walled", "--no-nav2", "--no-twin", "--no-record")
    run.wait_up()
    observer = join(run)
    button = Buttons(run, observer)
    inject_fault = observer.publisher(graph.SIM_FAULT).publish
    # Without navigation the mission waits in BOOT.
    start_process(run, "mission", "-p", "MissionOrchestrator.localization_timeout_s=4.0")
    button.press_and_release("BOOT")
    start_process(run, "nav")
    button.press_and_release("READY")
    # Without odometry the pose is not trusted.
    doubts: list[float] = []
    observer.node.subscription(graph.AMCL_POSE, lambda pose: doubts.append(pose.pose.covariance[0]))
    inject_fault(String(data="odometry silent"))
    # They come once a second: when the second one is here, the mission has the first.
    observer.until(lambda: sum(variance > 1.0 for variance in doubts) >= 2, "doubt about the pose")
    assert button.start(goal=1).accepted
    button.press_and_release("PREPARE.LOCALIZING")
    button.resume()
    button.press_and_release("FAULT")
    inject_fault(String(data="odometry none"))
    assert button.call(graph.MISSION_RESET).success
    button.until_state("READY")
    button.until("pose", lambda: True)
    # Without the camera no tag is discovered, which would end EXPLORING before the press is heard.
    inject_fault(String(data="camera silent"))
    # The first tag may be seen across a part of the house that is not explored yet, and be out of reach.
    assert button.start(goal=3).accepted
    button.press_and_release("EXPLORING", driving=True)
    inject_fault(String(data="camera none"))
    button.resume()
    button.press_and_release("MONITORING.NAVIGATING", driving=True, timeout_s=240.0)
    button.resume()
    button.press_and_release("MONITORING.SCANNING")
    button.resume()
    tag = button.mission.current_target
    button.until("end of the reading", lambda: button.mission.targets_completed > 0)
    assert button.call(graph.MISSION_ABORT).success
    button.press_and_release("RETURNING", driving=True)
    button.resume()
    button.press_and_release("DONE")
    assert button.start(tag).accepted
    button.press_and_release("INSPECTING.NAVIGATING", driving=True)
    button.resume()
    button.press_and_release("INSPECTING.SCANNING")
    button.resume()
    button.until_state("DONE")
    assert button.start(tag).accepted
    button.press_and_release("INSPECTING.NAVIGATING", driving=True)
    # PUBLISHING takes no time, so the mission stays in it only while it is paused.
    assert button.call(graph.MISSION_SKIP).success
    button.press_and_release("INSPECTING.PUBLISHING")
    button.resume()
    button.until_state("DONE")
    assert button.mission.targets_skipped == 1
    passed_at_once = {"MONITORING.PUBLISHING"}
    assert button.pressed_in == set(build_hsm_spec().leaves()) - passed_at_once
    assert run.simulator()["collisions"] == 0
    assert run.lupin("down").returncode == 0


def test_mission_that_leaves_its_map_ends_with_that_reason(
    launch: Callable[..., Any],
    join: Callable[..., Any],
    save_start: Callable[..., str],
    start_process: Callable[..., subprocess.Popen[bytes]],
) -> None:
    from lupin_runtime.ros import TransformListener

    bare = ("--headless", "--json", "--world", "demo", "--no-twin", "--no-perception", "--no-record", "--no-cameras")
    run = launch("--map", save_start(*bare), *bare)
    run.wait_up()
    start = run.wait(lambda: run.simulator().get("pose"), "word of the simulator")
    observer = join(run)
    tree = TransformListener(observer.node).tree
    mission = Buttons(run, observer)
    # Without viewpoints it drives to the map's border at once.
    start_process(
        run,
        "mission",
        "-p",
        "MissionOrchestrator.coverage_enabled=false",
        "-p",
        "MissionOrchestrator.localization_timeout_s=5.0",
    )
    mission.until_state("READY")
    assert mission.start(goal=1).accepted
    mission.until("a lost robot", lambda: mission.mission.last_error == "robot_lost", 240.0)
    run.wait(lambda: run.speed_m_s() < AT_REST_M_S, "rest of the lost robot")
    believed, truth = tree.lookup(graph.MAP_FRAME, graph.BASE_FRAME).translation, run.simulator()["pose"]
    assert math.hypot(believed[0] - (truth["x"] - start["x"]), believed[1] - (truth["y"] - start["y"])) < 0.2
    mission.until_state("FAULT")
    assert mission.mission.last_error == "robot_not_found"
    assert run.simulator()["collisions"] == 0
    assert run.lupin("down").returncode == 0
