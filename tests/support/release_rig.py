"""Measures how far the robot still moves when the e-stop is released and no newer command comes, for a source of motion.

The motion of the base is read from the simulator's true trajectory, that of arm and gripper from their joint states.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lupin_runtime import graph
from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED
from tests.support.graph_client import GraphClient
from tests.support.hang import Hang, is_replaced, send
from tests.support.true_path import Sample, parse_path

if TYPE_CHECKING:
    from tests.support.motion_sources import MotionSource

STREAM_PERIOD_S = 0.05
STREAM_M_S = 0.15
MOVING_M_S = 0.05
MOVING_RAD_S = 0.1
# Two positions on the map with free space between them; goals are at the one that is farther away.
POSITIONS = ((0.1, 0.0), (1.5, 0.0))
MOVED_M, MOVED_RAD = 0.05, 0.05
AT_REST_RAD = 0.02
SEQUENCE = "release_rig"
MOTION_TIMEOUT_S = 20.0
# What was sent is handled within this time: before it begins to move, the arm would be found at rest.
ARRIVAL_S = 0.5
# A killed process counts as a publisher of the e-stop until its DDS lease expires, which the nodes notice at different times. A
# goal that comes in between is refused, and an operator would send it again.
ATTEMPTS_AFTER_RESTART = 3


@dataclass(frozen=True)
class Measured:
    """The largest motion of the base (m), and of arm and gripper (rad), after the release."""

    base_m: float
    joints_rad: float
    newer_command_moves: bool  # whether the robot moved after a newer command
    joints_rest_s: float = 0.0  # how long arm and gripper moved on after the press, or after the signal to a process


class ReleaseRig(GraphClient):
    """A client on the graph of a simulated run that moves it and measures its motion."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, "release_rig")
        self._streams: dict[tuple[Any, int], float | None] = {}
        self._turn = 0
        self._mission: subprocess.Popen[bytes] | None = None
        self._joints: dict[str, float] = {}
        self._joint_history: list[tuple[float, dict[str, float]]] = []
        self.engaged: bool | None = None
        self.button_down = False
        self.mission = ""
        self.mission_paused = False
        self.locks: list[str] = []
        self.sign = 1.0
        self.node.subscription(graph.JOINT_STATES, self._on_joints)
        self.node.subscription(graph.ESTOP_STATE, self._on_estop)
        self.node.subscription(graph.ESTOP_BUTTON, self._on_button)
        self.node.subscription(graph.MISSION_STATE, self._on_mission)
        self.node.subscription(graph.DRIVE_STATUS, self._on_drive)
        self.node.create_timer(STREAM_PERIOD_S / 2, self._publish_streams)
        self.start()
        self.until(lambda: self._joint_history and self.engaged is not None, "joint states and e-stop state")

    def close(self) -> None:
        """Leave the graph, and terminate the mission's process."""
        if self._mission is not None:
            self._mission.terminate()
            self._mission.wait(60)
        super().close()

    # -- messages ------------------------------------------------------------------------------------------------------
    def _on_joints(self, message: Any) -> None:
        joints = (*graph.ARM_JOINTS, graph.GRIPPER_JOINT)
        self._joints.update((name, at) for name, at in zip(message.name, message.position) if name in joints)
        self._joint_history.append((time.monotonic(), dict(self._joints)))
        del self._joint_history[:-3000]

    def _on_estop(self, message: Any) -> None:
        self.engaged = bool(message.data)

    def _on_button(self, message: Any) -> None:
        self.button_down = bool(message.value)

    def _on_mission(self, message: Any) -> None:
        self.mission, self.mission_paused = str(message.lifecycle_state), bool(message.paused)

    def _on_drive(self, message: Any) -> None:
        self.locks = json.loads(message.data)["locks"]

    def _publish_streams(self) -> None:
        # Publishers with even and odd numbers take turns, so that neither of them always has an input's newest message.
        self._turn = 1 - self._turn
        for (publisher, number), speed in list(self._streams.items()):
            if speed is not None and number % 2 == self._turn:
                publisher.publish(_stream_message(publisher.msg_type, speed))

    # -- requests ------------------------------------------------------------------------------------------------------
    def stream(self, row: graph.Topic, speed_m_s: float | None, number: int = 0) -> None:
        """Publish a velocity at 20 Hz from now on, or nothing any more if it is None. That of a jog is the pan's, in rad/s."""
        self._streams[self.publisher(row, number), number] = speed_m_s

    def set_estop(self, engaged: bool) -> None:
        """Press or release the simulated button, and wait until the e-stop's state and the drive bus show it.

        The drive bus is released only when the state has a single publisher, which takes up to 20 s after another one was
        killed.
        """
        self.call(graph.SIM_PRESS_ESTOP, data=engaged)
        self.until(lambda: self.engaged is engaged and bool(self.locks) is engaged, f"e-stop state {engaged}")

    def press_while_estop_hangs(self) -> None:
        """Press and release the button while `estop_bridge` hangs, and wait until the drive bus is locked by the e-stop.

        It does not wait for the e-stop's state: the process that replaces `estop_bridge` may have released it before this
        client discovers its publisher.
        """
        send(self.folder, Hang("estop"))
        self.call(graph.SIM_PRESS_ESTOP, data=True)
        self.until(lambda: self.button_down, "message of the pressed button")
        self.call(graph.SIM_PRESS_ESTOP, data=False)
        self.until(lambda: ESTOP_ENGAGED in self.locks, "lock of the drive bus by the e-stop")

    def press_while_hanging(self, hang: Hang) -> None:
        """Press the button while another process hangs, and wait until that process has been replaced."""
        pid = send(self.folder, hang)
        self.call(graph.SIM_PRESS_ESTOP, data=True)
        self.until(lambda: is_replaced(self.folder, hang.process, pid), f"replacement of {hang.process}")
        self.set_estop(True)

    # -- motion --------------------------------------------------------------------------------------------------------
    def trajectory(self) -> list[Sample]:
        """Return the robot's true path. The last second may be missing."""
        return parse_path((self.folder / "truth_trajectory.tum").read_text())

    def _state(self) -> dict[str, Any]:
        state: dict[str, Any] = json.loads((self.folder / "sim_state.json").read_text())
        return state

    def wait_for_position(self) -> tuple[float, float, float]:
        """Wait for the simulator's next state, and return its time (s), x and y (m)."""
        then = self._state()["sim_time_s"]
        state = self.until(lambda: (new := self._state())["sim_time_s"] > then and new, "state of the simulator")
        return float(state["sim_time_s"]), float(state["pose"]["x"]), float(state["pose"]["y"])

    def speed_m_s(self) -> float:
        """Return the robot's true speed, which may be a second old."""
        return math.hypot(*self._state()["twist"][:2])

    def joint_speed_rad_s(self) -> float:
        """Return the largest joint speed of arm and gripper over the last 0.2 s."""
        history = self._joint_history
        newest = history[-1]
        earlier = next((row for row in reversed(history) if row[0] <= newest[0] - 0.2), history[0])
        return _largest_change(earlier[1], newest[1]) / max(newest[0] - earlier[0], 1e-3)

    def is_moving(self) -> bool:
        """Return whether the base or a joint moves."""
        return self.speed_m_s() > MOVING_M_S or self.joint_speed_rad_s() > MOVING_RAD_S

    def wait_for_rest(self) -> None:
        """Wait until base and arm are at rest."""
        self.until(lambda: self.speed_m_s() < 1e-3 and self.joint_speed_rad_s() < 0.01, "rest")

    # -- measuring -----------------------------------------------------------------------------------------------------
    def measure(self, source: MotionSource, press_s: float, watch_s: float, hang: Hang | None = None) -> Measured:
        """Start the source, press the e-stop for `press_s`, release it, and watch for `watch_s`; then give a newer command.

        With `hang`, a process gets a signal just before the press. If that is `estop`, the button is released at once, and the
        process that replaces `estop_bridge` engages and releases the e-stop.
        """
        estop_hangs = hang is not None and hang.process == "estop"
        self.sign = -self.sign
        try:
            source.start(self)
            self.until(self.is_moving, f"motion by {source.name}")
            pressed_s = time.monotonic()
            if estop_hangs:
                self.press_while_estop_hangs()
            elif hang is not None:
                self.press_while_hanging(hang)
            else:
                self.set_estop(True)
                time.sleep(press_s)
                source.while_engaged(self)
                time.sleep(ARRIVAL_S)
            self.wait_for_rest()
            began_s, x, y = self.wait_for_position()
            joints = self._joint_history[-1]
            rest_s = self._joints_rest_s(pressed_s)
            self.set_estop(False)  # waits for the release
            time.sleep(watch_s)
            self.wait_for_position()
            ended_s, _, _ = self.wait_for_position()
            base_m = max(math.dist((x, y), row[1:]) for row in self.trajectory() if began_s <= row[0] <= ended_s)
            joints_rad = max(_largest_change(joints[1], at) for time_s, at in list(self._joint_history) if time_s >= joints[0])
            history = self._joint_history[-1]
            for _ in range(ATTEMPTS_AFTER_RESTART if estop_hangs else 1):
                source.newer_command(self)
                moves = self._moves((x, y), history[1], MOTION_TIMEOUT_S / (ATTEMPTS_AFTER_RESTART if estop_hangs else 1))
                if moves:
                    break
        finally:
            self.set_estop(False)
            source.stop(self)
            self._streams = dict.fromkeys(self._streams)
        self.wait_for_rest()
        return Measured(base_m, joints_rad, moves, rest_s)

    def _joints_rest_s(self, since_s: float) -> float:
        """Return how long after `since_s` arm and gripper were farther than AT_REST_RAD from where they are now."""
        history = list(self._joint_history)
        away = [time_s for time_s, at in history if _largest_change(history[-1][1], at) > AT_REST_RAD]
        return max(0.0, max(away, default=since_s) - since_s)

    def _moves(self, position: tuple[float, float], joints: dict[str, float], timeout_s: float) -> bool:
        def moved() -> bool:
            return (
                math.dist(position, self.wait_for_position()[1:]) > MOVED_M
                or _largest_change(joints, self._joint_history[-1][1]) > MOVED_RAD
            )

        try:
            return bool(self.until(moved, "motion by a newer command", timeout_s))
        except AssertionError:
            return False

    # -- sources -------------------------------------------------------------------------------------------------------
    def goal_pose(self) -> Any:
        """Return the one of POSITIONS that is farther from the robot, as a pose in the map frame."""
        from geometry_msgs.msg import PoseStamped

        first = self.trajectory()[0]
        at = self.wait_for_position()
        # The map's origin is the robot's start.
        x, y = max(POSITIONS, key=lambda position: math.dist(position, (at[1] - first[1], at[2] - first[2])))
        message = PoseStamped()
        message.header.frame_id = graph.MAP_FRAME
        message.pose.position.x, message.pose.position.y, message.pose.orientation.w = x, y, 1.0
        return message

    def go(self) -> None:
        """Send a NavigateToPose goal."""
        from nav2_msgs.action import NavigateToPose

        self.send(graph.NAVIGATE_TO_POSE, NavigateToPose.Goal(pose=self.goal_pose()))

    def go_through(self) -> None:
        """Send a NavigateThroughPoses goal of two poses."""
        from nav2_msgs.action import NavigateThroughPoses

        last = self.goal_pose()
        middle = self.goal_pose()
        middle.pose.position.x = (POSITIONS[0][0] + POSITIONS[1][0]) / 2
        self.send(graph.NAVIGATE_THROUGH_POSES, NavigateThroughPoses.Goal(poses=[middle, last]))

    def publish_goal_pose(self) -> None:
        """Publish a goal on /goal_pose, like a click in RViz."""
        self.publisher(graph.GOAL_POSE).publish(self.goal_pose())

    def cancel(self) -> None:
        """Cancel every navigation goal of every client."""
        from action_msgs.srv import CancelGoal

        for row in (graph.NAVIGATE_TO_POSE, graph.NAVIGATE_THROUGH_POSES):
            name = f"{row.name}/_action/cancel_goal"
            client = self._clients.setdefault(name, None) or self.node.create_client(CancelGoal, name)
            self._clients[name] = client
            self.until(client.service_is_ready, name)
            self.until(client.call_async(CancelGoal.Request()).done, f"response of {name}")

    def zero_then_stream(self, row: graph.Topic, silent_s: float = 0.0) -> None:
        """Publish zero for a second, or nothing for `silent_s`, and then a velocity from now on."""
        self.stream(row, None if silent_s else 0.0)
        time.sleep(silent_s or 1.0)
        self.stream(row, STREAM_M_S * self.sign)

    def preset(self, name: str) -> None:
        """Move the arm to a preset."""
        answer = self.call(graph.ARM_PRESET, name=name)
        if not answer.success:
            raise RuntimeError(answer.message)

    def other_preset(self) -> None:
        """Move the arm to `home` or `tuck`, whichever it is not at."""
        lift = self._joint_history[-1][1][graph.ARM_JOINTS[1]]
        self.preset("home" if lift < -0.4 else "tuck")

    def send_trajectory(self) -> None:
        """Send a slow motion of the pan joint on the vendor's topic, bypassing the arm's servers."""
        from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

        at = self._joint_history[-1][1]
        positions = [at[joint] for joint in graph.ARM_JOINTS]
        positions[0] = -0.8 if positions[0] > 0.0 else 0.8
        point = JointTrajectoryPoint(positions=positions)
        point.time_from_start.sec = 4
        message = JointTrajectory(joint_names=list(graph.ARM_JOINTS), points=[point])
        self.publisher(graph.ARM_TRAJECTORY).publish(message)

    def play(self) -> None:
        """Replay a motion of the arm slowly; record it first if it does not exist."""
        listing = json.loads(self.call(graph.ARM_LIBRARY_LIST).json)
        if SEQUENCE not in [row["name"] for row in listing["sequences"]]:
            self.preset("home")
            time.sleep(3.5)  # until the arm is there
            self.call(graph.ARM_LIBRARY_RECORD, action="start", name=SEQUENCE, mode="teleop")
            self.preset("tuck")
            time.sleep(3.5)  # until the arm is there
            self.call(graph.ARM_LIBRARY_RECORD, action="save")
        answer = self.call(graph.ARM_LIBRARY_PLAY, name=SEQUENCE, speed=0.25)
        if not answer.success:
            raise RuntimeError(answer.message)

    def grip(self) -> None:
        """Send the gripper to the farther end of its range, as a client of the vendor's action."""
        from control_msgs.action import GripperCommand

        goal = GripperCommand.Goal()
        goal.command.position = -0.20 if self._joint_history[-1][1][graph.GRIPPER_JOINT] > 0.0 else 0.25
        goal.command.max_effort = 2.0
        self.send(graph.GRIPPER_COMMAND, goal)

    def start_mission(self) -> None:
        """Start an exploration. The mission's process is started first: a run without `--mission` has none."""
        if self._mission is None:
            command = [sys.executable, "-m", "lupin_cli.app", "run", "mission"]
            environment = {**os.environ, "XDG_STATE_HOME": str(self.folder.parents[2])}
            with (self.folder / "logs" / "release_rig_mission.log").open("wb") as log:
                self._mission = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
        self.until(lambda: self.mission in ("READY", "DONE"), "mission that can be started")
        # A process that has just started takes a press of the last 20 s for its own, and refuses for a moment.
        self.until(self._is_mission_accepted, "mission that is accepted")
        # It may even hear of that press after the start, and is then paused.
        self.until(self._is_mission_exploring, "mission that explores")

    def _is_mission_accepted(self) -> bool:
        answer = self.call(graph.MISSION_START, mission_type="ExplorationMission", discovery_goal=65535)
        return bool(answer.accepted)

    def _is_mission_exploring(self) -> bool:
        if self.mission_paused:
            self.call(graph.MISSION_RESUME)
        return self.mission == "EXPLORING" and not self.mission_paused

    def abort_mission(self) -> None:
        """Abort twice: the first abort drives to the dock, the second ends the mission where the robot is."""
        self.call(graph.MISSION_ABORT)
        self.call(graph.MISSION_ABORT)


def _stream_message(message_type: Any, speed: float) -> Any:
    from geometry_msgs.msg import Twist
    from sensor_msgs.msg import JointState

    if message_type is JointState:
        return JointState(name=[graph.ARM_JOINTS[0]], velocity=[speed])
    message = Twist()
    message.linear.x = speed
    return message


def _largest_change(a: dict[str, float], b: dict[str, float]) -> float:
    return max(abs(b[name] - at) for name, at in a.items())
