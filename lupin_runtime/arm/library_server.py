"""`arm_library_server`: records, stores and replays poses and sequences of the arm."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mirte_msgs.srv import SetServoAngleWithSpeed
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.timer import Timer
from std_msgs.msg import String
from std_srvs.srv import SetBool

from lupin_runtime import graph
from lupin_runtime.arm import async_wait
from lupin_runtime.arm.library import LibraryError, StoredPose, now_text, valid_name
from lupin_runtime.arm.limits import GRIPPER_CLOSED_RAD, GRIPPER_OPEN_RAD, clamp_arm, gripper_deg
from lupin_runtime.arm.motion import Refused
from lupin_runtime.arm.player import ArmPlayer, points_of
from lupin_runtime.arm.presets import PRESET_DURATION_S
from lupin_runtime.arm.recorder import MODES, ArmRecorder
from lupin_runtime.arm.shared_arm import ArmNode
from lupin_runtime.arm.store import LibraryStore, default_path
from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED

STATE_HZ = 5.0
SAMPLE_HZ = 50.0  # only while something records
PLAY_HZ = 100.0  # only while something plays: the gripper's goals of a replay are late by up to a period
STOP_S = 0.3
HELD_UP_S = 0.5  # between two samples of a replay
GRIPPER_RATE_DEGPS = 45.0
# set_torque waits for two services in sequence, and possibly for an earlier call of set_torque.
TORQUE_ANSWER_S = 12.0

_REFUSALS = (LibraryError, Refused, ValueError, OSError)


@dataclass(eq=False)
class _Activity:
    """An accepted recording or replay. `began_ns` is None until it starts. Two of the same name are not equal."""

    kind: str  # recording or playing
    name: str
    mode: str = ""
    began_ns: int | None = None
    recorder: ArmRecorder | None = None
    player: ArmPlayer | None = None
    estop_count: int = 0  # the arm's count when the activity was accepted
    stop_count: int = 0  # the arm's count when the replay was sent
    sampled_ns: int = 0  # when the last sample was taken, in monotonic time

    @property
    def limp(self) -> bool:
        return self.recorder is not None and self.mode == "kinesthetic"


class ArmLibraryServer(ArmNode):
    """The node of the arm library. Parameter: `library_path` (default: arm_library.json in the user's configuration folder)."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("arm_library_server", parameters)
        path = self.parameter("library_path", "")
        self._store = LibraryStore(Path(path).expanduser() if path else default_path())
        if self._store.complaint:
            self.get_logger().error(self._store.complaint)
        self._activity: _Activity | None = None
        self._aborted = ""  # why the last replay was aborted
        group = ReentrantCallbackGroup()  # these services await responses of other services
        self._torque = self.client(graph.ARM_SET_TORQUE, group)
        self._gripper = self.client(graph.GRIPPER_ANGLE, group)
        self._state = self.publisher(graph.ARM_LIBRARY_STATE)
        for row, callback in (
            (graph.ARM_LIBRARY_LIST, self._on_list),
            (graph.ARM_LIBRARY_SAVE_POSE, self._on_save_pose),
            (graph.ARM_LIBRARY_GOTO_POSE, self._on_goto_pose),
            (graph.ARM_LIBRARY_DELETE, self._on_edit),
            (graph.ARM_LIBRARY_RECORD, self._on_record),
            (graph.ARM_LIBRARY_PLAY, self._on_play),
            (graph.ARM_LIBRARY_STOP, self._on_stop),
        ):
            self.service(row, callback, group)
        self.create_timer(1.0 / STATE_HZ, self._publish_state)
        self._sampler: Timer | None = None

    # -- poses --------------------------------------------------------------------------------------------------------
    def _on_list(self, _: Any, response: Any) -> Any:
        response.success, response.json = True, self._store.listing()
        return response

    def _on_save_pose(self, request: Any, response: Any) -> Any:
        try:
            name = self._store.put("pose", request.name, self._pose_of(request), request.overwrite)
        except _REFUSALS as refusal:
            return _failed(response, refusal)
        response.success, response.message = True, f"pose {name} saved"
        return response

    def _pose_of(self, request: Any) -> StoredPose:
        if not request.from_current:
            gripper = _clamp_gripper(request.gripper_rad) if request.has_gripper else None
            return StoredPose(clamp_arm(request.arm_rad), gripper, now_text())
        state = self.motion.state(fresh=True)
        if state is None:
            raise Refused("the current pose is unknown: no fresh /joint_states with all four arm joints")
        gripper = state.gripper if request.has_gripper else None
        return StoredPose(clamp_arm(state.arm), None if gripper is None else _clamp_gripper(gripper), now_text())

    def _on_goto_pose(self, request: Any, response: Any) -> Any:
        try:
            pose = self._store.get("pose", request.name)
            self.motion.move(pose.arm, PRESET_DURATION_S)
        except _REFUSALS as refusal:
            return _failed(response, refusal)
        if pose.gripper is not None:
            self._send_gripper(pose.gripper)
        response.success, response.message = True, f"moving to {request.name.strip().lower()}, {PRESET_DURATION_S:g} s"
        return response

    def _on_edit(self, request: Any, response: Any) -> Any:
        try:
            if request.new_name:
                name = self._store.rename(request.kind, request.name, request.new_name)
                response.message = f"renamed to {name}"
            else:
                self._store.delete(request.kind, request.name)
                response.message = "deleted"
        except _REFUSALS as refusal:
            return _failed(response, refusal)
        response.success = True
        return response

    # -- recording ----------------------------------------------------------------------------------------------------
    async def _on_record(self, request: Any, response: Any) -> Any:
        actions = {"start": self._record_start, "save": self._record_save, "cancel": self._record_cancel}
        action = actions.get(request.action.strip().lower())
        try:
            if action is None:
                raise LibraryError(f"action is {request.action!r}, expected one of {', '.join(actions)}")
            response.message = await action(request, response)
        except _REFUSALS as refusal:
            return _failed(response, refusal)
        response.success = True
        return response

    async def _record_start(self, request: Any, _: Any) -> str:
        mode = request.mode.strip().lower() or "teleop"
        if mode not in MODES:
            raise LibraryError(f"mode is {request.mode!r}, expected one of {', '.join(MODES)}")
        name = valid_name(request.name) if request.name.strip() else ""
        if mode == "kinesthetic":
            self.motion.require_released()  # the arm sinks when it becomes limp
        activity = self._begin(_Activity("recording", name, mode, recorder=ArmRecorder(mode, request.include_gripper)))
        if mode == "kinesthetic":
            try:
                await self._set_torque(False)
            except Refused:
                self._end(activity)
                raise
        if self._activity is not activity:
            raise Refused("stopped before it began")
        self._run(activity)
        return f"recording, {mode}"

    async def _record_save(self, request: Any, response: Any) -> str:
        activity, recorder = self._recording()
        sequence = recorder.finish()
        if sequence is None:
            raise LibraryError("nothing was recorded: no /joint_states with all four arm joints arrived")
        # The recording continues if it cannot be stored, so that it is not lost because its name is taken.
        name = self._store.put("sequence", request.name or activity.name, sequence, request.overwrite)
        self._end(activity)
        response.duration_s, response.n_waypoints = sequence.duration_s, len(sequence.waypoints)
        message = f"sequence {name} saved" + (", truncated at the longest duration" if recorder.truncated else "")
        return message + await self._stiffen(activity)

    async def _record_cancel(self, _: Any, __: Any) -> str:
        activity, _recorder = self._recording()
        self._end(activity)
        return "recording discarded" + await self._stiffen(activity)

    def _recording(self) -> tuple[_Activity, ArmRecorder]:
        activity = self._activity
        if activity is None or activity.recorder is None or activity.began_ns is None:
            raise Refused("nothing is being recorded")
        return activity, activity.recorder

    async def _stiffen(self, activity: _Activity) -> str:
        """Switch the torque on after a kinesthetic recording; return an addition to the response's message."""
        if not activity.limp:
            return ""
        try:
            await self._set_torque(True)
        except Refused as refusal:
            return f"; but the arm is still limp: {refusal}"
        return "; torque on"

    # -- replay -------------------------------------------------------------------------------------------------------
    async def _on_play(self, request: Any, response: Any) -> Any:
        activity = None
        try:
            self.motion.require_released()
            sequence = self._store.get("sequence", request.name)
            name = valid_name(request.name)
            activity = self._begin(_Activity("playing", name, sequence.mode))
            self.motion.hold(_holder(activity))
            if self.motion.torque is not True:
                await self._set_torque(True)
            if self._activity is not activity:
                raise Refused("stopped before it began")
            self.motion.require_released(since=activity.estop_count)
            activity.stop_count = self.motion.stop_count
            path = self.motion.play(points_of(sequence), request.speed, _holder(activity))
        except _REFUSALS as refusal:
            self._end(activity)
            return _failed(response, refusal)
        activity.player = ArmPlayer(sequence, path, request.speed)
        self._run(activity)
        response.success, response.message = True, f"playing {name}, {activity.player.duration_s:.1f} s"
        return response

    async def _on_stop(self, _: Any, response: Any) -> Any:
        activity = self._activity
        self._end(activity)
        self.motion.stop(STOP_S)
        what = f"{activity.kind} ended" if activity is not None else "nothing was running"
        response.success = True
        response.message = what + (await self._stiffen(activity) if activity is not None else "")
        return response

    # -- shared by recording and replay --------------------------------------------------------------------------------
    def _begin(self, activity: _Activity) -> _Activity:
        """Reserve the arm for a recording or replay, before anything is awaited."""
        if self._activity is not None:
            raise Refused(f"the arm is busy: {self._activity.kind} {self._activity.name}".rstrip() + "; stop that first")
        activity.estop_count = self.motion.estop_count
        self._activity, self._aborted = activity, ""
        return activity

    def _run(self, activity: _Activity) -> None:
        if self._activity is activity:
            activity.began_ns, activity.sampled_ns = self.elapsed_clock_ns(), self.monotonic_ns()
            self._sampler = self.create_timer(1.0 / (PLAY_HZ if activity.player is not None else SAMPLE_HZ), self._on_sample)

    def _end(self, activity: _Activity | None) -> None:
        if activity is None or self._activity is not activity:
            return  # one that was stopped before it began has ended already; the arm may be reserved for another one
        self._activity = None
        self.motion.release(_holder(activity))
        if self._sampler is not None:
            # Destroyed, not cancelled: in simulated time a cancelled timer wakes the executor with every clock message.
            self.destroy_timer(self._sampler)
            self._sampler = None

    def _elapsed_s(self, activity: _Activity) -> float:
        return 0.0 if activity.began_ns is None else max(0.0, (self.elapsed_clock_ns() - activity.began_ns) / 1e9)

    def _on_sample(self) -> None:
        activity = self._activity
        if activity is None:
            return
        elapsed_s = self._elapsed_s(activity)
        if activity.recorder is not None:
            state = self.motion.state(fresh=True)
            if state is not None:
                activity.recorder.offer(elapsed_s, state.arm, state.gripper)
        if activity.player is not None and (reason := self._interruption(activity)):
            self._aborted = reason
            self.get_logger().warning(f"{_holder(activity)} aborted: {reason}")
            self._end(activity)
            if reason != ESTOP_ENGAGED:
                self.motion.stop_soon()
        elif activity.player is not None:
            angle = activity.player.due(elapsed_s)
            if angle is not None:
                self._send_gripper(angle)
            if activity.player.over(elapsed_s) or self.motion.torque is False:
                self._end(activity)

    def _interruption(self, activity: _Activity) -> str:
        """Return why a replay must not go on; an empty string if it may."""
        now_ns, before_ns = self.monotonic_ns(), activity.sampled_ns
        activity.sampled_ns = now_ns
        if activity.estop_count != self.motion.estop_count:
            return ESTOP_ENGAGED
        if activity.stop_count != self.motion.stop_count:
            return "the arm was stopped"
        held_up_s = 0.0 if self.simulated_time else (now_ns - before_ns) / 1e9  # a simulation may pause, and its arm with it
        # The arm's guard may have held the arm meanwhile.
        return f"this process was held up for {held_up_s:.1f} s" if held_up_s > HELD_UP_S else ""

    async def _set_torque(self, on: bool) -> None:
        """Switch the torque. Raises Refused unless the switch is confirmed."""
        answer = await async_wait.call(self, self._torque, SetBool.Request(data=on), TORQUE_ANSWER_S)
        if answer is None:
            raise Refused(f"{graph.ARM_SET_TORQUE.name} did not respond; check that gripper_action_bridge runs")
        if not answer.success:
            raise Refused(answer.message)

    def _send_gripper(self, angle_rad: float) -> None:
        if not self._gripper.service_is_ready():
            self.get_logger().warning(
                f"{graph.GRIPPER_ANGLE.name} has no server: the gripper is not moved", throttle_duration_sec=5.0
            )
            return
        request = SetServoAngleWithSpeed.Request(angle=gripper_deg(angle_rad), rate=GRIPPER_RATE_DEGPS, degrees=True)
        self._gripper.call_async(request)

    def _publish_state(self) -> None:
        activity = self._activity
        state: dict[str, Any] = {
            "recording": activity is not None and activity.kind == "recording",
            "playing": activity is not None and activity.kind == "playing",
            "name": "",
            "mode": "",
            "progress": 0.0,
            "elapsed_s": 0.0,
            "n_waypoints": 0,
            "torque": self.motion.torque is not False,
            "aborted": self._aborted,
        }
        if activity is not None:
            elapsed_s = self._elapsed_s(activity)
            state.update(name=activity.name, mode=activity.mode, elapsed_s=round(elapsed_s, 2))
            if activity.recorder is not None:
                state["n_waypoints"] = activity.recorder.count
            if activity.player is not None:
                state["progress"] = round(activity.player.progress(elapsed_s), 3)
        self._state.publish(String(data=json.dumps(state)))


def _holder(activity: _Activity) -> str:
    return f"{activity.kind} {activity.name}"


def _clamp_gripper(angle_rad: float) -> float:
    gripper_deg(angle_rad)  # raises ValueError for a non-finite angle
    return min(GRIPPER_CLOSED_RAD, max(GRIPPER_OPEN_RAD, angle_rad))


def _failed(response: Any, refusal: Exception) -> Any:
    response.success, response.message = False, str(refusal)
    return response
