"""The colors of the LED strip, and the color of each mission state."""

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

# All colors above.
COLORS_BY_NAME = {name: value for name, value in globals().items() if isinstance(value, Rgb)}

# The colors of the lifecycle states of a mission in progress, and of one that is not.
IN_PROGRESS_COLORS = {
    "PREPARE": YELLOW,
    "EXPLORING": SPRING,
    "INSPECTING": CYAN,
    "MONITORING": TEAL,
    "RETURNING": ORANGE,
}
RESTING_COLORS = {"BOOT": WHITE, "READY": BLUE, "DONE": GREEN}
LIFECYCLE_COLORS = {**IN_PROGRESS_COLORS, **RESTING_COLORS}
# The color of a mission phase is shown instead of that of the lifecycle state.
PHASE_COLORS = {"SCANNING": PURPLE, "CONFIRMING": PURPLE, "PUBLISHING": WHITE}

# Of a robot by itself, with or without a laptop. A robot that needs help is not red: red promises that it does not move.
READY = BLUE  # steady; also if there is nothing else to show
HOMING = YELLOW  # these blink
WAITING = WHITE
HELP = Rgb(255, 0, 255)  # not among the colors that a person may choose


def byte_order(order: str) -> tuple[int, int, int]:
    """Return the indices of an Rgb's components in the order in which a strip expects their bytes.

    `order` names the colors that the first, second and third byte light; an invalid `order` counts as RGB. The robot's strip is
    wired BRG: its first byte, which the vendor calls r, lights blue.
    """
    order = order.strip().upper()
    if sorted(order) != ["B", "G", "R"]:
        order = "RGB"
    first, second, third = ("RGB".index(letter) for letter in order)
    return first, second, third
