"""Progress of a replay: its gripper events and its end."""

from __future__ import annotations

from collections.abc import Sequence

from lupin_runtime.arm.library import StoredSequence
from lupin_runtime.arm.recorder import gripper_events
from lupin_runtime.arm.trajectory import Point, clamp_speed


def points_of(sequence: StoredSequence) -> tuple[Point, ...]:
    """Convert a sequence's waypoints to points of a trajectory."""
    return tuple(Point(waypoint.t, waypoint.arm) for waypoint in sequence.waypoints)


class ArmPlayer:
    """Follows a replay that was sent as `path` at `speed` times the recorded speed. Times are seconds since it was sent."""

    def __init__(self, sequence: StoredSequence, path: Sequence[Point], speed: float) -> None:
        start_s, speed = sequence.waypoints[0].t, clamp_speed(speed)
        self._lead_in_s = path[0].t_s
        self._events = [(self._lead_in_s + (t - start_s) / speed, rad) for t, rad in gripper_events(sequence)]
        self.duration_s = max(path[-1].t_s, *(t_s for t_s, _ in self._events)) if self._events else path[-1].t_s

    def due(self, elapsed_s: float) -> float | None:
        """Return the gripper angle to send now, in rad, or None; if several events are due, that of the last."""
        angle = None
        while self._events and self._events[0][0] <= elapsed_s:
            angle = self._events.pop(0)[1]
        return angle

    def progress(self, elapsed_s: float) -> float:
        """Return 0 at the start, 1 at the end."""
        return min(1.0, max(0.0, elapsed_s / self.duration_s))

    def over(self, elapsed_s: float) -> bool:
        """Return whether the time of the last point is reached."""
        return elapsed_s >= self.duration_s
