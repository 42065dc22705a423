"""The vendor's topics, services and actions for the simulated robot: servos, LEDs, controllers, arm and gripper."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from control_msgs.action import FollowJointTrajectory, GripperCommand
from controller_manager_msgs.msg import ControllerState
from controller_manager_msgs.srv import SwitchController
from geometry_msgs.msg import Twist
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from std_msgs.msg import Float32
from trajectory_msgs.msg import JointTrajectory

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_sim import mirte, trajectory
from lupin_sim.controllers import TYPES, ControllerReply
from lupin_sim.engine import Simulation
from lupin_sim.servos import NAMES, angle_range

POLL_S = 0.05
# The vendor's goal tolerances, and how late an arm may arrive.
ARM_TOLERANCE_RAD = mirte.STALL_ERROR_RAD
GRIPPER_TOLERANCE_RAD = 0.05
ARRIVAL_GRACE_S = 1.5
GRIPPER_LIMIT_S = 3.0


class VendorInterface:
    """Connects a simulation to the names of the vendor's topics, services and actions."""

    def __init__(self, node: LupinNode, simulation: Simulation) -> None:
        self._node, self._simulation = node, simulation
        for row in (graph.CMD_VEL_SINK_ROBOT, graph.CMD_VEL_SINK_SIM):
            node.subscription(row, self._drive)
        node.subscription(graph.ARM_TRAJECTORY, self._follow_trajectory)
        node.subscription(graph.SIM_BATTERY, self._set_battery)
        node.service(graph.SIM_PRESS_ESTOP, self._press_estop)
        node.service(graph.VENDOR_LEDS, self._set_leds)
        node.service(graph.VENDOR_TORQUE, self._set_torque)
        node.service(graph.VENDOR_ARM_GATE, self._set_gate)
        for index, name in enumerate(NAMES):
            node.service(graph.servo_set_angle(name), partial(self._set_servo, index))
            node.service(graph.servo_range(name), partial(self._get_range, index))
            node.service(graph.servo_offset(name), partial(self._get_offset, index))
            node.service(graph.servo_set_offset(name), partial(self._set_offset, index))
        node.service(graph.LIST_CONTROLLERS, self._list_controllers)
        node.service(graph.LOAD_CONTROLLER, partial(self._change_controller, simulation.controllers.load))
        node.service(graph.CONFIGURE_CONTROLLER, partial(self._change_controller, simulation.controllers.configure))
        node.service(graph.SWITCH_CONTROLLER, self._switch_controllers)
        self._arm = _DeferredAction(
            node,
            FollowJointTrajectory,
            graph.ARM_FOLLOW_TRAJECTORY.name,
            self._check_trajectory,
            self._start_trajectory,
        )
        self._gripper = _DeferredAction(
            node, GripperCommand, graph.GRIPPER_COMMAND.name, self._check_gripper, self._start_gripper
        )

    # -- base ---------------------------------------------------------------------------------------------------------
    def _drive(self, message: Twist) -> None:
        # A planar base uses only these three components.
        self._simulation.command_twist(message.linear.x, message.linear.y, message.angular.z)

    # -- arm and gripper ----------------------------------------------------------------------------------------------
    def _follow_trajectory(self, message: JointTrajectory) -> None:
        if not self._simulation.controllers.is_active("mirte_master_arm_controller"):
            self._warn("the arm controller is not active: trajectory ignored")
            return
        try:
            parsed = _parse(message)
        except trajectory.TrajectoryRefused as refusal:
            self._warn(f"trajectory ignored: it {refusal}")
            return
        with self._simulation.lock:
            self._simulation.arm.follow(parsed, self._simulation.time_s)

    def _check_trajectory(self, goal: FollowJointTrajectory.Goal) -> GoalResponse:
        if not self._simulation.controllers.is_active("mirte_master_arm_controller"):
            self._warn("the arm controller is not active: goal rejected")
            return GoalResponse.REJECT
        try:
            _parse(goal.trajectory)
        except trajectory.TrajectoryRefused as refusal:
            self._warn(f"goal rejected: its trajectory {refusal}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _start_trajectory(self, goal: FollowJointTrajectory.Goal) -> Callable[[bool], _GoalEnd | None]:
        simulation = self._simulation
        parsed = _parse(goal.trajectory)
        with simulation.lock:
            number = simulation.arm.follow(parsed, simulation.time_s)
        deadline_s = simulation.time_s + parsed.times_s[-1] + ARRIVAL_GRACE_S
        goal_position = parsed.points[-1]
        result = FollowJointTrajectory.Result

        def poll(cancelled: bool) -> _GoalEnd | None:
            with simulation.lock:
                angles = list(simulation.servos.angles[:4])
                if cancelled:
                    if simulation.arm.goals == number:
                        simulation.arm.hold(simulation.arm.command)
                    return _GoalEnd("canceled", result())
                if simulation.arm.goals != number:
                    return _GoalEnd("aborted", result(error_string="replaced by another trajectory"))
                stalled = [name for name in simulation.servos.stalled if name != "gripper"]
            error = max(abs(a - b) for a, b in zip(angles, goal_position))
            if stalled:
                text = f"{', '.join(stalled)} stalled"
                return _GoalEnd("aborted", result(error_code=result.PATH_TOLERANCE_VIOLATED, error_string=text))
            if simulation.arm.finished and error < ARM_TOLERANCE_RAD:
                return _GoalEnd("succeeded", result(error_code=result.SUCCESSFUL))
            if simulation.time_s > deadline_s:
                text = f"still {error:.2f} rad off"
                return _GoalEnd("aborted", result(error_code=result.GOAL_TOLERANCE_VIOLATED, error_string=text))
            return None

        return poll

    def _check_gripper(self, goal: GripperCommand.Goal) -> GoalResponse:
        if not self._simulation.controllers.is_active("mirte_master_gripper_controller"):
            self._warn("the gripper controller is not active: goal rejected")
            return GoalResponse.REJECT
        if not math.isfinite(goal.command.position):
            self._warn(f"gripper goal rejected: position {goal.command.position} is not finite")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _start_gripper(self, goal: GripperCommand.Goal) -> Callable[[bool], _GoalEnd | None]:
        simulation = self._simulation
        goal_position = min(max(goal.command.position, mirte.GRIPPER_LOWER_RAD), mirte.GRIPPER_UPPER_RAD)
        with simulation.lock:
            simulation.gripper_command = goal_position
        deadline_s = simulation.time_s + GRIPPER_LIMIT_S

        def poll(cancelled: bool) -> _GoalEnd | None:
            with simulation.lock:
                at = simulation.servos.angles[-1]
                if cancelled:
                    simulation.gripper_command = at
                replaced = simulation.gripper_command != goal_position and not cancelled
                stalled = "gripper" in simulation.servos.stalled or simulation.time_s > deadline_s
            reached = abs(at - goal_position) < GRIPPER_TOLERANCE_RAD
            if not (cancelled or replaced or reached or stalled):
                return None
            result = GripperCommand.Result(position=at, stalled=stalled and not reached, reached_goal=reached)
            return _GoalEnd("canceled" if cancelled else "succeeded" if reached else "aborted", result)

        return poll

    # -- servo bus, LEDs, button, battery -----------------------------------------------------------------------------
    def _set_servo(self, index: int, request: Any, response: Any) -> Any:
        angle = math.radians(request.angle) if request.degrees else request.angle
        response.status = math.isfinite(angle)
        if response.status:
            with self._simulation.lock:
                self._simulation.servos.set_angle(index, angle)
        return response

    def _get_range(self, index: int, _request: Any, response: Any) -> Any:
        response.min, response.max = angle_range(index)
        return response

    def _get_offset(self, index: int, _request: Any, response: Any) -> Any:
        response.centidegrees = self._simulation.servos.offsets_counts[index]
        return response

    def _set_offset(self, index: int, request: Any, response: Any) -> Any:
        with self._simulation.lock:
            self._simulation.servos.offsets_counts[index] = request.centidegrees
        return response

    def _set_torque(self, request: Any, response: Any) -> Any:
        with self._simulation.lock:
            self._simulation.servos.set_torque(request.data)
        return _succeed(response, "servos on" if request.data else "servos off")

    def _set_gate(self, request: Any, response: Any) -> Any:
        with self._simulation.lock:
            self._simulation.servos.gate_open = request.data
        return _succeed(response, "arm control enabled" if request.data else "arm control disabled")

    def _set_leds(self, request: Any, response: Any) -> Any:
        self._simulation.set_leds(request.color.r, request.color.g, request.color.b)
        response.status = True
        return response

    def _press_estop(self, request: Any, response: Any) -> Any:
        self._simulation.estop_pressed = request.data
        return _succeed(response, "pressed" if request.data else "released")

    def _set_battery(self, message: Float32) -> None:
        if not 0.0 <= message.data <= 1.0:
            self._warn(f"battery fraction {message.data} ignored: it is not in 0..1")
            return
        with self._simulation.lock:
            self._simulation.battery = float(message.data)

    # -- controller manager -------------------------------------------------------------------------------------------
    def _list_controllers(self, _request: Any, response: Any) -> Any:
        manager = self._simulation.controllers
        response.controller = [
            ControllerState(name=name, state=manager.states[name], type=TYPES[name]) for name in manager.loaded
        ]
        return response

    def _change_controller(self, change: Callable[[str], ControllerReply], request: Any, response: Any) -> Any:
        with self._simulation.lock:
            reply = change(request.name)
        if not reply.ok:
            self._warn(reply.message)
        response.ok = reply.ok
        return response

    def _switch_controllers(self, request: Any, response: Any) -> Any:
        ok, message = self._simulation.switch_controllers(
            [*request.activate_controllers, *request.start_controllers],
            [*request.deactivate_controllers, *request.stop_controllers],
            strict=request.strictness != SwitchController.Request.BEST_EFFORT,
        )
        # With BEST_EFFORT the reply is ok even if some changes were not possible.
        response.ok = ok or request.strictness == SwitchController.Request.BEST_EFFORT
        if message:
            self._warn(message)
        return response

    def _warn(self, text: str) -> None:
        self._node.get_logger().warning(text, throttle_duration_sec=1.0)


class _GoalEnd:
    """How a goal ended: the final state of the goal handle, and the action's result."""

    def __init__(self, state: str, result: Any) -> None:
        self.state, self.result = state, result


class _DeferredAction:
    """An action server whose goals are polled by a timer.

    rclpy's executor spins at full speed while an asynchronous execute callback awaits something, and a blocking callback would
    block the node. So a goal is executed only when it has ended, and its execute callback just returns the result.
    """

    def __init__(
        self,
        node: LupinNode,
        action: Any,
        name: str,
        check: Callable[[Any], GoalResponse],
        start: Callable[[Any], Callable[[bool], _GoalEnd | None]],
    ) -> None:
        self._start = start
        self._running: list[tuple[ServerGoalHandle, Callable[[bool], _GoalEnd | None]]] = []
        self._timer = node.create_timer(POLL_S, self._poll)
        self._timer.cancel()
        self._server = ActionServer(
            node,
            action,
            name,
            execute_callback=self._finish,
            goal_callback=check,
            handle_accepted_callback=self._accept,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self._ends: dict[bytes, _GoalEnd] = {}

    def _accept(self, goal: ServerGoalHandle) -> None:
        self._running.append((goal, self._start(goal.request)))
        self._timer.reset()

    def _poll(self) -> None:
        unfinished = []
        for goal, poll in self._running:
            end = poll(goal.is_cancel_requested)
            if end is None:
                unfinished.append((goal, poll))
                continue
            self._ends[bytes(goal.goal_id.uuid)] = end
            goal.execute()
        self._running = unfinished
        if not unfinished:
            self._timer.cancel()

    def _finish(self, goal: ServerGoalHandle) -> Any:
        end = self._ends.pop(bytes(goal.goal_id.uuid))
        # The goal may have been cancelled meanwhile; a cancelled goal can only end as canceled or aborted.
        if end.state == "succeeded" and not goal.is_cancel_requested:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return end.result


def _parse(message: JointTrajectory) -> trajectory.Trajectory:
    times_s = [p.time_from_start.sec + p.time_from_start.nanosec * 1e-9 for p in message.points]
    return trajectory.parse(message.joint_names, [p.positions for p in message.points], times_s)


def _succeed(response: Any, message: str) -> Any:
    response.success, response.message = True, message
    return response
