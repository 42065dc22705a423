"""The vendor's controller_manager: five controllers and their states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lupin_runtime.graph import CONTROLLERS

UNLOADED, UNCONFIGURED, INACTIVE, ACTIVE = "unloaded", "unconfigured", "inactive", "active"
STATES = (UNLOADED, UNCONFIGURED, INACTIVE, ACTIVE)
TYPES = {
    "joint_state_broadcaster": "joint_state_broadcaster/JointStateBroadcaster",
    "mirte_master_arm_controller": "joint_trajectory_controller/JointTrajectoryController",
    "mirte_master_gripper_controller": "position_controllers/GripperActionController",
    "pid_wheels_controller": "pid_controller/PidController",
    "mirte_base_controller": "mecanum_drive_controller/MecanumDriveController",
}
# The base controller writes the wheel controller's references, so it cannot be active without it.
NEEDS = {"mirte_base_controller": "pid_wheels_controller"}


@dataclass(frozen=True)
class ControllerReply:
    """The reply to a request; `message` explains a refusal."""

    ok: bool
    message: str = ""


class ControllerManager:
    """The states of the five controllers, and the transitions that ros2_control allows between them."""

    def __init__(self, state: str = ACTIVE) -> None:
        if state not in STATES:
            raise ValueError(f"controllers cannot start in state {state!r}; choose one of {', '.join(STATES)}")
        self.states = dict.fromkeys(CONTROLLERS, state)

    def is_active(self, name: str) -> bool:
        """Return whether a controller is active, together with the one that it needs."""
        needed = NEEDS.get(name)
        return self.states[name] == ACTIVE and (needed is None or self.states[needed] == ACTIVE)

    @property
    def loaded(self) -> tuple[str, ...]:
        """The names of the loaded controllers."""
        return tuple(name for name, state in self.states.items() if state != UNLOADED)

    def load(self, name: str) -> ControllerReply:
        """Load a controller: unloaded -> unconfigured."""
        return self._move(name, UNLOADED, UNCONFIGURED)

    def configure(self, name: str) -> ControllerReply:
        """Configure a controller: unconfigured -> inactive; an inactive one may be configured again."""
        if self.states.get(name) == INACTIVE:
            return ControllerReply(True)
        return self._move(name, UNCONFIGURED, INACTIVE)

    def switch(self, activate: Sequence[str], deactivate: Sequence[str], strict: bool) -> ControllerReply:
        """Activate and deactivate controllers. With `strict`, nothing changes unless all changes are possible; otherwise the
        possible ones are made, and the message names the others."""
        after = dict(self.states)
        problems = []
        for names, source, target in ((deactivate, ACTIVE, INACTIVE), (activate, INACTIVE, ACTIVE)):
            for name in names:
                if after.get(name) == target:
                    continue
                if after.get(name) != source:
                    problems.append(f"{name} is {after.get(name, 'unknown')}, not {source}")
                    continue
                after[name] = target
        for name, needed in NEEDS.items():
            if after[name] == ACTIVE and after[needed] != ACTIVE:
                problems.append(f"{name} needs {needed} active")
                after[name] = self.states[name] if self.states[name] != ACTIVE else INACTIVE
        if problems and strict:
            return ControllerReply(False, "; ".join(problems))
        self.states = after
        return ControllerReply(not problems, "; ".join(problems))

    def _move(self, name: str, source: str, target: str) -> ControllerReply:
        state = self.states.get(name)
        if state != source:
            return ControllerReply(False, f"{name} is {state or 'not a controller of this robot'}, not {source}")
        self.states[name] = target
        return ControllerReply(True)
