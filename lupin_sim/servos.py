"""The servo bus: five servos with set-points, torque, offsets, a command gate, and the vendor's stall rule."""

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
    """Angles are radians in the order of NAMES; `angles` are what the encoders read, offsets taken off.

    Two gates stand between a controller and a joint: `gate_open` lets the vendor's hardware interface write to the bus,
    `torque` lets the servos push. A controller keeps wanting what it wanted: opening the gate of an arm that was moved by
    hand makes it jump, as on the robot.
    """

    angles: list[float]
    setpoints: list[float] = field(init=False)
    references: list[float] = field(init=False)  # set-points as the servos approach them, at their limited speed
    torque: bool = True
    gate_open: bool = True
    offsets_counts: list[int] = field(default_factory=lambda: [0] * len(NAMES))
    _sent: list[float] = field(init=False)
    _stuck_s: list[float] = field(init=False)

    def __post_init__(self) -> None:
        self.setpoints = list(self.angles)
        self.references = list(self.angles)
        self._sent = [math.nan] * len(NAMES)
        self._stuck_s = [0.0] * len(NAMES)

    def write(self, wanted: Sequence[float | None]) -> None:
        """The hardware interface's cycle: send a controller's command where it changed, or where the servo sits further
        than 0.05 rad from it. None means that no controller claims this servo."""
        if not self.gate_open:
            return
        for i, angle in enumerate(wanted):
            if angle is None:
                continue
            if angle != self._sent[i] or abs(self.angles[i] - angle) > mirte.SERVO_REASSERT_RAD:
                self.set_angle(i, angle)
                self._sent[i] = angle

    def set_angle(self, index: int, angle_rad: float) -> None:
        """Send one servo somewhere, within its limits."""
        self.setpoints[index] = min(max(angle_rad, _LOWER[index]), _UPPER[index])

    def set_torque(self, on: bool) -> None:
        """Limp, or stiff at the angles where the joints are now."""
        if on and not self.torque:
            self.setpoints = list(self.angles)
            self.references = list(self.angles)
        self.torque = on

    def read(self, physical: Sequence[float]) -> None:
        """Take the joints' real angles, radians."""
        self.angles = [angle - count * RAD_PER_COUNT for angle, count in zip(physical, self.offsets_counts)]

    def targets(self, dt_s: float) -> list[float]:
        """Advance the references by `dt_s` at the servos' speed and return them as real joint angles."""
        for i, setpoint in enumerate(self.setpoints):
            step = _SPEED[i] * dt_s
            self.references[i] += min(max(setpoint - self.references[i], -step), step)
            off = self.torque and abs(self.references[i] - self.angles[i]) > mirte.STALL_ERROR_RAD
            self._stuck_s[i] = self._stuck_s[i] + dt_s if off else 0.0
        return [angle + count * RAD_PER_COUNT for angle, count in zip(self.references, self.offsets_counts)]

    @property
    def stalled(self) -> tuple[str, ...]:
        """Servos that have been more than 0.10 rad off for more than a second."""
        return tuple(name for name, stuck in zip(NAMES, self._stuck_s) if stuck > mirte.STALL_AFTER_S)

    def raw_counts(self, index: int) -> int:
        """A servo's raw position, hundredths of a degree with its home count."""
        return round(_HOME[index] + self.angles[index] / RAD_PER_COUNT)


def angle_range(index: int) -> tuple[float, float]:
    """A servo's limits in radians."""
    return _LOWER[index], _UPPER[index]
