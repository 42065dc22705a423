"""The servo bus: five servos with setpoints, torque, offsets, a command gate, and the vendor's stall rule."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from lupin_sim import mirte

RAD_PER_COUNT = math.radians(0.01)
NAMES = (*(servo.servo for servo in mirte.SERVOS), "gripper")
_LOWER = (*(servo.lower_rad for servo in mirte.SERVOS), mirte.GRIPPER_LOWER_RAD)
_UPPER = (*(servo.upper_rad for servo in mirte.SERVOS), mirte.GRIPPER_UPPER_RAD)
_SPEED = (*(mirte.SERVO_SPEED_RADPS for _ in mirte.SERVOS), mirte.GRIPPER_SPEED_RADPS)
_HOME = (*(servo.home_counts for servo in mirte.SERVOS), mirte.GRIPPER_HOME_COUNTS)


@dataclass
class ServoBus:
    """The state of all servos: radians in the order of NAMES; `angles` are the encoder readings minus the offsets.

    `gate_open` lets the vendor's hardware interface write to the bus, `torque` lets the servos hold and move. A controller
    keeps its last command, so an arm that was moved by hand jumps when the gate opens, as on the robot.
    """

    angles: list[float]
    setpoints: list[float] = field(init=False)
    references: list[float] = field(init=False)  # move to the setpoints at the servos' limited speed
    torque: bool = True
    gate_open: bool = True
    offsets_counts: list[int] = field(default_factory=lambda: [0] * len(NAMES))
    _sent: list[float] = field(init=False)
    _stalled_s: list[float] = field(init=False)

    def __post_init__(self) -> None:
        self.setpoints = list(self.angles)
        self.references = list(self.angles)
        self._sent = [math.nan] * len(NAMES)
        self._stalled_s = [0.0] * len(NAMES)

    def write(self, commands: Sequence[float | None]) -> None:
        """Run one cycle of the hardware interface: send commands that changed, and those whose servo is over 0.05 rad off.

        None means that no controller commands this servo.
        """
        if not self.gate_open:
            return
        for i, angle in enumerate(commands):
            if angle is None:
                continue
            if angle != self._sent[i] or abs(self.angles[i] - angle) > mirte.SERVO_REASSERT_RAD:
                self.set_angle(i, angle)
                self._sent[i] = angle

    def set_angle(self, index: int, angle_rad: float) -> None:
        """Set the setpoint of one servo, clamped to its limits."""
        self.setpoints[index] = min(max(angle_rad, _LOWER[index]), _UPPER[index])

    def set_torque(self, on: bool) -> None:
        """Switch the torque; switched on, the servos hold their present angles."""
        if on and not self.torque:
            self.setpoints = list(self.angles)
            self.references = list(self.angles)
        self.torque = on

    def read(self, physical: Sequence[float]) -> None:
        """Read the encoders: takes the true joint angles, radians."""
        self.angles = [angle - count * RAD_PER_COUNT for angle, count in zip(physical, self.offsets_counts)]

    def targets(self, dt_s: float) -> list[float]:
        """Advance the references by `dt_s` at the servos' speed, and return them as true joint angles."""
        for i, setpoint in enumerate(self.setpoints):
            step = _SPEED[i] * dt_s
            self.references[i] += min(max(setpoint - self.references[i], -step), step)
            is_off = self.torque and abs(self.references[i] - self.angles[i]) > mirte.STALL_ERROR_RAD
            self._stalled_s[i] = self._stalled_s[i] + dt_s if is_off else 0.0
        return [angle + count * RAD_PER_COUNT for angle, count in zip(self.references, self.offsets_counts)]

    @property
    def stalled(self) -> tuple[str, ...]:
        """Servos that have been more than 0.10 rad off for more than a second."""
        return tuple(name for name, stalled_s in zip(NAMES, self._stalled_s) if stalled_s > mirte.STALL_AFTER_S)

    def raw_counts(self, index: int) -> int:
        """Return the raw position of a servo, in hundredths of a degree from its home count."""
        return round(_HOME[index] + self.angles[index] / RAD_PER_COUNT)


def angle_range(index: int) -> tuple[float, float]:
    """Return the limits of a servo, radians."""
    return _LOWER[index], _UPPER[index]
