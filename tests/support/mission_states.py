"""Leaf states of the mission, grouped for parametrized tests."""

MOVING_LEAVES = ["EXPLORING", "INSPECTING.NAVIGATING", "MONITORING.NAVIGATING", "RETURNING"]
RESUMABLE_LEAVES = [
    "EXPLORING",
    *(f"{state}.{leaf}" for state in ("INSPECTING", "MONITORING") for leaf in ("NAVIGATING", "SCANNING", "PUBLISHING")),
]
BUSY_LEAVES = ["PREPARE.LOCALIZING", *RESUMABLE_LEAVES, "RETURNING"]
