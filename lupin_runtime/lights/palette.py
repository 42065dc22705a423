"""The colors of the LED strip, and those of the mission's states."""

from __future__ import annotations

from typing import NamedTuple


class Rgb(NamedTuple):
    """A color; each component is 0..255."""

    r: int
    g: int
    b: int


RED = Rgb(255, 0, 0)
AMBER = Rgb(255, 191, 0)
WHITE = Rgb(255, 255, 255)
BLUE = Rgb(0, 0, 255)
YELLOW = Rgb(255, 255, 0)
SPRING = Rgb(0, 255, 128)
CYAN = Rgb(0, 255, 255)
TEAL = Rgb(0, 180, 140)
PURPLE = Rgb(180, 0, 255)
ORANGE = Rgb(255, 128, 0)
GREEN = Rgb(0, 255, 0)
BATTERY_LOW = Rgb(255, 0, 128)
OFF = Rgb(0, 0, 0)

COLORS = {name: value for name, value in globals().items() if isinstance(value, Rgb)}

# Lifecycle states of a mission in progress, and of one at rest.
IN_PROGRESS = {
    "PREPARE": YELLOW,
    "EXPLORING": SPRING,
    "INSPECTING": CYAN,
    "MONITORING": TEAL,
    "RETURNING": ORANGE,
}
RESTING = {"BOOT": WHITE, "READY": BLUE, "DONE": GREEN}
LIFECYCLE = {**IN_PROGRESS, **RESTING}
# The color of a phase replaces that of its lifecycle state.
PHASE = {"SCANNING": PURPLE, "CONFIRMING": PURPLE, "PUBLISHING": WHITE}

STANDBY = BLUE


def permutation(order: str) -> tuple[int, int, int]:
    """For each byte sent, the index into an Rgb of the color that it drives; RGB for an invalid `order`.

    The robot's strip is wired BRG: the byte called r drives its blue.
    """
    order = order.strip().upper()
    if sorted(order) != ["B", "G", "R"]:
        order = "RGB"
    first, second, third = ("RGB".index(letter) for letter in order)
    return first, second, third
