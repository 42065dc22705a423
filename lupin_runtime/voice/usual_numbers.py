"""How usual the numbers of a call are: people say round ones, and a recognizer confuses 30 with 13, or "one" with 0.1."""

from __future__ import annotations

import math

from lupin_runtime.voice.utterance import Call

_UNUSUAL = 2.0  # by which a call is less likely for each number that is not usual, as a logarithm
_TOLERANCE = 1e-3
# A number is usual if it is a multiple of one of these, in the unit of its argument.
_ANGLES_DEG = (30.0, 45.0)
_STEPS = {
    **dict.fromkeys(("angle_deg", "rotate_deg"), _ANGLES_DEG),
    "yaw": tuple(map(math.radians, _ANGLES_DEG)),
    "angular_z": tuple(map(math.radians, (10.0, 15.0))),
    **dict.fromkeys(("linear_x", "linear_y"), (0.1,)),
    **dict.fromkeys(("forward_m", "lateral_m", "x", "y", "duration_s"), (0.5,)),
    "percent": (10.0, 25.0),
    "value": (0.1, 0.25),
    "speed": (0.25,),
}


def rate_numbers(call: Call) -> float:
    """Return by how much a call is less likely than one whose numbers are all usual: 0 or below, as a logarithm."""
    return -_UNUSUAL * sum(not _is_usual(value, _STEPS[name]) for name, value in call.arguments.items() if name in _STEPS)


def _is_usual(value: float, steps: tuple[float, ...]) -> bool:
    return any(abs(value / step - round(value / step)) < _TOLERANCE for step in steps)
