"""The robot as a voice session reaches it: through the bridge, as a client of its browser's session.

So its commands pass the same checks, limits and journal as those of the page.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, TypeVar

from lupin_runtime import graph
from lupin_runtime.console.authority import Refused, Session
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.command_era import Refusal
from lupin_runtime.console.drive_burst import DriveBurst, Velocity
from lupin_runtime.console.locations import BadLocation, all_locations, locations_file
from lupin_runtime.console.outbox import Frame
from lupin_runtime.console.robot_watch import RobotWatch
from lupin_runtime.geometry import Pose2, quaternion_from_yaw
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.type_names import absolute
from lupin_runtime.voice.envelope import Envelope, Situation
from lupin_runtime.voice.executor import CommandFailed, RobotState
from lupin_runtime.voice.tools import Tool

CALL_TIMEOUT_S = 25.0  # a calibration settles for some seconds, and a recording may have to switch the torque
DRIVEN_BY_HAND = "the operator is driving by hand"
AGENT_OF = "voice agent of {name}"
NO_BUS = "no drive bus receives velocities, so nothing would move; see: lupin doctor"
NO_NAVIGATION = "no navigation receives goals, so nothing would move; see: lupin doctor"
_EVERY_GOAL = {"goal_info": {"goal_id": {"uuid": [0] * 16}, "stamp": {"sec": 0, "nanosec": 0}}}
_NAVIGATION = (graph.NAVIGATE_TO_POSE, graph.NAVIGATE_THROUGH_POSES, graph.FOLLOW_WAYPOINTS)

_Result = TypeVar("_Result")
ChangeLocation = Callable[[Session, str, dict[str, float]], Awaitable[Any]]


class ConsoleRobot:
    """Implements `lupin_runtime.voice.executor.Robot`, and `Client` of the bridge. Used on the event loop.

    `settings` returns the page's settings by name, and `change_location` saves a location for all browsers.
    """

    def __init__(
        self,
        session: Session,
        bridge: Bridge,
        envelope: Envelope,
        watch: RobotWatch,
        settings: Callable[[], Mapping[str, Any]],
        change_location: ChangeLocation,
        burst_ended: Callable[[], None],
    ) -> None:
        self.session = session
        self._bridge = bridge
        self._envelope = envelope
        self._watch = watch
        self._settings = settings
        self._change_location = change_location
        self._still_valid = bridge.command_refusal()  # of the burst
        self._problem = ""  # of the last request, as its text
        self._burst = DriveBurst(self._send_velocity, self._burst_problem, burst_ended)
        bridge.join(self)

    def close(self) -> None:
        """End the burst, and leave the bridge."""
        self._burst.close()
        self._bridge.leave(self)

    # -- Client: nothing is subscribed, and no request of the protocol is answered --------------------------------------
    def deliver(self, _: Frame) -> None:
        """Drop a frame of a topic."""

    def answer(self, _: dict[str, Any]) -> None:
        """Drop an answer of the protocol."""

    def status(self, level: str, text: str, _identifier: Any = None) -> None:
        """Log an error of a request, and keep it for the call that waits for it."""
        self._problem = text
        self._bridge.log_request(self.session, level, text)

    # -- what the envelope must know ------------------------------------------------------------------------------------
    def take_control(self) -> None:
        """Take control if it is free: when one of several calls took it later, it would outdate the others."""
        with contextlib.suppress(Refused):  # it is named when the call is judged
            self._bridge.authority.take(self.session, time.monotonic_ns())

    def command_refusal(self) -> Refusal:
        """Return what a call that arrives now must ask before it is carried out."""
        return self._bridge.command_refusal()

    async def situation(self, tool: Tool, arrived: Refusal) -> Situation:
        """Return what the envelope must know to judge a call of a tool; `arrived` is the refusal of when it arrived."""
        pose = await self.map_pose() if tool.needs_pose else None
        now_ns = time.monotonic_ns()
        control_refusal = ""
        try:
            self._bridge.authority.check_take(self.session, now_ns)
        except Refused as refusal:
            control_refusal = str(refusal)
        settings = self._settings()
        return Situation(
            now_ns,
            self.estop_reasons(),
            control_refusal,
            settings["voiceMaxLinearMps"],
            settings["voiceMaxAngularRps"],
            pose is not None,
            arrived(),
            self._bridge.command_refusal(),
        )

    def estop_reasons(self) -> tuple[str, ...]:
        """Return what engages the e-stop; empty if it is released."""
        return tuple(hold["text"] for hold in self._bridge.manual.stops())

    # -- Robot ----------------------------------------------------------------------------------------------------------
    @property
    def is_inverted(self) -> bool:
        """Whether the setting polarityInvertHmi is on."""
        return bool(self._settings()["polarityInvertHmi"])

    @property
    def gripper_rate_degps(self) -> float:
        """The rate of the arm's joints by the settings."""
        return float(self._settings()["armRateDegPerSec"])

    @property
    def speed_limits(self) -> tuple[float, float]:
        """The maximum speed of a burst in m/s and rad/s, with the session's cap."""
        settings, cap = self._settings(), self._envelope.speed_cap
        return settings["voiceMaxLinearMps"] * cap, settings["voiceMaxAngularRps"] * cap

    @property
    def is_driving(self) -> bool:
        """Whether a burst is running."""
        return self._burst.is_running

    async def call(self, service: graph.Service, arguments: dict[str, Any]) -> dict[str, Any]:
        """Call a service as the page does. Raises CommandFailed."""
        return await self._call(service.name, arguments)

    async def _call(self, service: str, arguments: dict[str, Any]) -> dict[str, Any]:
        try:
            self._bridge.authority.check_call(self.session, service, time.monotonic_ns())
        except Refused as refusal:
            raise CommandFailed(str(refusal)) from refusal
        loop = asyncio.get_running_loop()
        answered: asyncio.Future[tuple[bool, Any]] = loop.create_future()

        def finish(succeeded: bool, response: Any) -> None:
            if not answered.done():  # it is cancelled if the operator interrupts
                answered.set_result((succeeded, response))

        def hand_over(succeeded: bool, response: Any) -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed: the console is stopping
                loop.call_soon_threadsafe(finish, succeeded, response)

        self._bridge.call_service(self, service, arguments, CALL_TIMEOUT_S, hand_over)
        succeeded, response = await answered
        if not succeeded:
            raise CommandFailed(str(response))
        return dict(response)

    async def cancel_navigation(self) -> str:
        """Cancel every goal of navigation, and return what its servers answered."""
        services = [f"{absolute(action.name)}/_action/cancel_goal" for action in _NAVIGATION]
        answers = await asyncio.gather(*(self._call(service, _EVERY_GOAL) for service in services), return_exceptions=True)
        served = [answer for answer in answers if isinstance(answer, dict)]
        if not served:
            raise CommandFailed(str(answers[0]))
        return f"goals that are being canceled: {sum(len(answer['goals_canceling']) for answer in served)}"

    async def send_goal(self, goal: Pose2) -> None:
        """Send the robot to a pose on the map. Raises CommandFailed."""
        settings = self._settings()
        topic = settings["goalPoseTopic"]
        await self._require_subscriber(topic, NO_NAVIGATION)
        try:
            self._bridge.authority.check_publish(self.session, topic, time.monotonic_ns())
        except Refused as refusal:
            raise CommandFailed(str(refusal)) from refusal
        turn = dict(zip("xyzw", quaternion_from_yaw(goal.yaw)))
        pose = {"position": {"x": goal.x, "y": goal.y, "z": 0.0}, "orientation": turn}
        contents = {"header": {"frame_id": settings["mapFrame"]}, "pose": pose}
        self._problem = ""
        self._bridge.publish(self, topic, graph.GOAL_POSE.type, None, contents, latch=False, queue_size=1)
        await self._read(lambda _: None)  # the executor's thread has published it, or has reported a problem
        if self._problem:
            raise CommandFailed(self._problem)

    async def _require_subscriber(self, topic: str, problem: str) -> None:
        """Check that somebody receives what is published: a command that nobody hears must not count as done."""
        if not await self._read(lambda node: node.count_subscribers(topic)):
            raise CommandFailed(problem)

    async def map_pose(self) -> Pose2 | None:
        """Return where the robot is on the map; None if that is not known."""
        return await self._read(lambda _: self._watch.map_pose())

    async def state(self) -> RobotState:
        """Return the robot's last state."""
        odometry, battery = await self._read(lambda _: (self._watch.odometry(), self._watch.battery()))
        return RobotState(odometry, battery, self.estop_reasons())

    async def light_rule(self) -> str:
        """Return the rule by which the light strip shows its light; empty if that is not known."""
        return await self._read(lambda _: self._watch.light_rule())

    async def _read(self, function: Callable[[LupinNode], _Result]) -> _Result:
        return await asyncio.wrap_future(self._bridge.run_with_node(function))

    async def locations(self) -> dict[str, Pose2]:
        """Return the named locations. Raises CommandFailed."""
        try:
            found = await asyncio.to_thread(all_locations, locations_file())
        except (ValueError, OSError) as error:
            raise CommandFailed(str(error)) from error
        return {name: Pose2(pose["x"], pose["y"], pose["yaw"]) for name, pose in found.items()}

    async def save_location(self, name: str, pose: Pose2) -> None:
        """Save or replace a named location. Raises CommandFailed."""
        try:
            await self._change_location(self.session, name, {"x": pose.x, "y": pose.y, "yaw": pose.yaw})
        except (Refused, BadLocation, ValueError, OSError) as error:
            raise CommandFailed(str(error)) from error

    # -- driving and stopping -------------------------------------------------------------------------------------------
    async def start_burst(self, linear_x: float, linear_y: float, angular_z: float, duration_s: float) -> None:
        """Drive with a velocity that ends by itself. Raises CommandFailed."""
        await self._require_subscriber(graph.CMD_VEL_MANUAL.name, NO_BUS)
        if self._bridge.manual.is_driven_by_others(self):
            raise CommandFailed(DRIVEN_BY_HAND)
        try:
            self._bridge.authority.check_publish(self.session, graph.CMD_VEL_MANUAL.name, time.monotonic_ns())
        except Refused as refusal:
            raise CommandFailed(str(refusal)) from refusal
        self._still_valid = self._bridge.command_refusal()
        self._burst.start((linear_x, linear_y, angular_z), duration_s)

    def stop_wheels(self) -> None:
        """End the burst, and send zero velocity, whoever has control: everybody may stop."""
        self._burst.end()

    def engage_stop(self) -> None:
        """End the burst, and engage the stop in the name of this session's agent: whoever has control releases it."""
        self._bridge.manual.stop_for(Session(AGENT_OF.format(name=self.session.name), self.session.role))
        self._burst.end()

    def _burst_problem(self) -> str:
        if not self._bridge.authority.holds(self.session, time.monotonic_ns()):
            return "control was lost"
        return DRIVEN_BY_HAND if self._bridge.manual.is_driven_by_others(self) else self._still_valid()

    def _send_velocity(self, velocity: Velocity) -> None:
        x, y, turn = velocity
        self._bridge.manual.drive(self, {"linear": {"x": x, "y": y, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": turn}})
