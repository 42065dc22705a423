"""`velocity_smoother`: limits velocity and acceleration of `/cmd_vel_nav` and publishes the result on `/cmd_vel_auto`."""

from __future__ import annotations

from typing import Any

from lupin_runtime import graph
from lupin_runtime.drive.smoother import AxisLimits, Smoother
from lupin_runtime.drive.twist import ZERO, Twist, decode, encode
from lupin_runtime.ros import LupinNode

AXES = ("x", "y", "yaw")


class VelocitySmoother(LupinNode):
    """The node of the velocity smoother.

    Parameters, each list in the order x, y, yaw: `max_velocity`, `min_velocity`, `max_accel`, `max_decel`,
    `deadband_velocity`; `smoothing_frequency` (Hz), `velocity_timeout` (s).
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("velocity_smoother", parameters)
        columns = {
            name: self._axes(name, default)
            for name, default in {
                "max_velocity": [0.5, 0.5, 1.9],
                "min_velocity": [-0.35, -0.5, -1.9],
                "max_accel": [2.5, 2.5, 3.2],
                "max_decel": [-2.5, -2.5, -3.2],
                "deadband_velocity": [0.0, 0.0, 0.0],
            }.items()
        }
        deadband = Twist(*columns.pop("deadband_velocity"))
        x, y, yaw = (AxisLimits(*axis) for axis in zip(*columns.values()))
        self._smoother = Smoother(x, y, yaw, timeout_s=self.parameter("velocity_timeout", 1.0), deadband=deadband)
        self._period_s = 1.0 / self.parameter("smoothing_frequency", 20.0)
        self._ticked_ns: int | None = None
        self._output = self.publisher(graph.CMD_VEL_AUTO)
        self.subscription(graph.CMD_VEL_NAV, self._on_command, qos=graph.BEST1, raw=True)
        self.create_timer(self._period_s, self._on_tick)

    def before_shutdown(self) -> None:
        """Publish zero as the last command of navigation."""
        self._output.publish(encode(ZERO))

    def _axes(self, name: str, default: list[float]) -> list[float]:
        values = list(self.parameter(name, default))
        if len(values) != len(AXES):
            raise ValueError(f"velocity_smoother: parameter {name} has {len(values)} values, expected x, y and yaw")
        return values

    def _on_command(self, data: bytes) -> None:
        self._smoother.command(decode(data), self.elapsed_clock_ns())

    def _on_tick(self) -> None:
        now_ns = self.elapsed_clock_ns()
        if LupinNode.motion_hold():
            self._smoother.command(ZERO, now_ns)  # the robot's drive bus knows nothing of the processes on this computer
        elapsed_s = self._period_s if self._ticked_ns is None else (now_ns - self._ticked_ns) / 1e9
        self._ticked_ns = now_ns
        # A late tick may catch up by one period, as more would be a jump in velocity. A clock that was set back counts as 0 s.
        out = self._smoother.tick(now_ns, min(2.0 * self._period_s, max(0.0, elapsed_s)))
        if out is not None:
            self._output.publish(encode(out))
