"""The arm's named poses in rad: pan, lift, elbow, wrist. Zero is straight up; positive leans back, or pans to the left."""

from __future__ import annotations

from lupin_runtime.arm.limits import Arm, clamp_arm

PRESET_DURATION_S = 3.0

PRESETS: dict[str, Arm] = {
    # The pose for parking: low load, because shoulder_lift overheats when it holds against gravity.
    "home": (0.04, -0.01, 0.01, -1.57),
    "zero": (0.0, 0.0, 0.0, 0.0),
    "tuck": (0.0, -1.40, 1.40, 0.0),
    "pick": (0.0, -0.60, 0.80, -0.40),
    "place": (0.0, 0.20, 0.80, -0.40),
    # Leans back, and from half a meter before a tag looks down at the pots by 0.1 rad. Every flower of the row is then in the
    # gripper camera's image, as measured on rendered frames. (The former pose, (0, -0.40, 0.90, -0.80), looked over them.)
    "inspect": (0.0, 0.60, -0.80, -1.47),
}


class UnknownPreset(ValueError):
    """No preset has this name; the message lists the presets."""


def preset(name: str) -> Arm:
    """Return the pose called `name` (trimmed, case-insensitive), within the command windows. Raises UnknownPreset."""
    key = name.strip().lower()
    if key not in PRESETS:
        raise UnknownPreset(f"no preset {name!r}; there are: {', '.join(PRESETS)}")
    return clamp_arm(PRESETS[key])
