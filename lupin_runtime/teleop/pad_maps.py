"""The table of pads: what identifies each one, and the event codes of its controls. Adding a pad is adding a row to MAPS.

The same pad has other codes with another driver, so a row is also found by the axes that the driver declares. Each of these
drivers reports a stick that is pushed forward or to the left as a value below the center.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace

from lupin_runtime.teleop.events import (
    ABS_BRAKE,
    ABS_GAS,
    ABS_HAT0X,
    ABS_HAT0Y,
    ABS_RX,
    ABS_RY,
    ABS_RZ,
    ABS_X,
    ABS_Y,
    ABS_Z,
    BTN_C,
    BTN_EAST,
    BTN_NORTH,
    BTN_SOUTH,
    BTN_TL,
    BTN_TL2,
    BTN_TR,
    BTN_TR2,
    BTN_WEST,
    BTN_Z,
    EV_ABS,
    EV_KEY,
)

USB, BLUETOOTH = 0x0003, 0x0005  # bus types of linux/input.h
XONE = 0x0006  # of the driver xone, for pads on a cable and on Microsoft's radio receiver
TRANSPORTS = {USB: "USB", BLUETOOTH: "Bluetooth", XONE: "xone"}
MICROSOFT, SONY, NINTENDO = 0x045E, 0x054C, 0x057E
# Receivers on the USB whose pads are on a radio link: those of the Xbox 360, and that of the DualShock 4.
_RECEIVERS = {(MICROSOFT, 0x0719), (MICROSOFT, 0x0291), (MICROSOFT, 0x02A1), (SONY, 0x0BA0)}
# Drivers that follow the kernel's gamepad layout, instead of the order of the pad's descriptor, set this bit of the version.
KERNEL_LAYOUT = 0x8000

SIGNED_16, UNSIGNED_16, UNSIGNED_10, UNSIGNED_8 = (-32768, 32767), (0, 65535), (0, 1023), (0, 255)
HAT = (-1, 1)
# Around the center of a stick, as a share of its way. A link by radio has the wider one.
DEAD_ZONES = {USB: 0.10, BLUETOOTH: 0.15}

LONG_BITS = 8 * struct.calcsize("l")


@dataclass(frozen=True)
class PadId:
    """What the kernel says of an input device: bus, vendor, product and version, and the keys and axes that it declares."""

    bus: int
    vendor: int
    product: int
    version: int
    keys: frozenset[int]
    axes: frozenset[int]


@dataclass(frozen=True)
class ArmControls:
    """The codes of the controls that move the arm. No stick is among them: the right one turns the base.

    `left` and `top` are the face buttons at these places, whose codes depend on the vendor. `open` and `close` are the codes of
    the triggers: of axes with `trigger_range`, which rest at its lower end, or of buttons without one.
    """

    left: int = BTN_WEST
    top: int = BTN_NORTH
    right: int = BTN_EAST
    bottom: int = BTN_SOUTH
    sideways: int = ABS_HAT0X  # directional pad
    forward: int = ABS_HAT0Y
    open: int = ABS_RZ
    close: int = ABS_Z
    trigger_range: tuple[int, int] | None = UNSIGNED_10

    @property
    def buttons(self) -> tuple[int, ...]:
        """The codes of all buttons."""
        triggers = (self.open, self.close) if self.trigger_range is None else ()
        return (self.left, self.top, self.right, self.bottom, *triggers)

    @property
    def ranges(self) -> dict[int, tuple[int, int]]:
        """The codes of all axes, with the ranges that they have where the device cannot be asked."""
        hats = {self.sideways: HAT, self.forward: HAT}
        return hats if self.trigger_range is None else {**hats, self.open: self.trigger_range, self.close: self.trigger_range}


# Drivers of Microsoft's pads call the buttons X and Y, which are those to the left and at the top, by each other's codes.
_XBOX_ARM = ArmControls(left=BTN_NORTH, top=BTN_WEST)


@dataclass(frozen=True)
class PadMap:
    """A pad with one driver: its identity, and the codes of its controls.

    `products` is empty if every product of the vendor will do. `version_bits` must all be set in the version. `declares` are
    axes by which the driver is known. `axis_range` is that of the sticks where the device cannot be asked. `above_center` are
    axes that report a stick that is pushed forward or to the left as a value above the center.
    """

    name: str
    buses: tuple[int, ...]
    vendor: int
    products: tuple[int, ...] = ()
    version_bits: int = 0
    declares: tuple[int, ...] = ()
    dead_man: int = BTN_TL
    turbo: int = BTN_TR
    lateral_axis: int = ABS_X  # left stick
    forward_axis: int = ABS_Y  # left stick
    yaw_axis: int = ABS_RX  # right stick
    axis_range: tuple[int, int] = SIGNED_16
    above_center: tuple[int, ...] = ()
    arm: ArmControls | None = None  # None: this pad does not move the arm

    @property
    def axes(self) -> tuple[int, int, int]:
        """The codes of the axes that drive: lateral, forward, yaw."""
        return self.lateral_axis, self.forward_axis, self.yaw_axis

    @property
    def ranges(self) -> dict[int, tuple[int, int]]:
        """The codes of all axes that have an effect, with their ranges where the device cannot be asked."""
        return {**(self.arm.ranges if self.arm else {}), **dict.fromkeys(self.axes, self.axis_range)}

    def control(self, kind: int, code: int) -> str:
        """Return the name of a key or an axis, as an event has it; empty if it has no effect."""
        buttons = {self.dead_man: "dead-man button", self.turbo: "turbo button"}
        sticks = dict(zip(self.axes, ("sideways", "forward", "turn")))
        if (arm := self.arm) is not None:
            triggers = {arm.open: "open gripper", arm.close: "close gripper"}
            faces = {arm.right: "pan left", arm.left: "pan right", arm.top: "lift back", arm.bottom: "lift forward"}
            buttons = {**(triggers if arm.trigger_range is None else {}), **faces, **buttons}
            axes = {**(triggers if arm.trigger_range else {}), arm.forward: "elbow", arm.sideways: "wrist"}
            sticks = {**axes, **sticks}
        return {EV_KEY: buttons, EV_ABS: sticks}.get(kind, {}).get(code, "")

    def fits(self, found: PadId) -> bool:
        """Return whether this is the row of a device. Other devices of a pad, such as its motion sensors, lack the buttons."""
        return (
            found.bus in self.buses
            and found.vendor == self.vendor
            and (not self.products or found.product in self.products)
            and found.version & self.version_bits == self.version_bits
            and found.keys >= {self.dead_man, self.turbo}
            and found.axes >= {*self.axes, *self.declares}
        )


# The first row that fits is used.
MAPS: tuple[PadMap, ...] = (
    # The first firmware of the Xbox One S over Bluetooth: its buttons have no gaps in their numbers.
    PadMap(
        "Xbox, old firmware",
        (BLUETOOTH,),
        MICROSOFT,
        products=(0x02E0,),
        declares=(ABS_RY, ABS_Z, ABS_RZ),
        dead_man=BTN_WEST,
        turbo=BTN_Z,
        axis_range=UNSIGNED_16,
        arm=ArmControls(left=BTN_C, top=BTN_NORTH),
    ),
    # hid-generic and hid-microsoft: the right stick is Z and RZ, the triggers are GAS and BRAKE.
    PadMap(
        "Xbox",
        (BLUETOOTH,),
        MICROSOFT,
        declares=(ABS_RZ, ABS_GAS, ABS_BRAKE),
        yaw_axis=ABS_Z,
        axis_range=UNSIGNED_16,
        arm=replace(_XBOX_ARM, open=ABS_GAS, close=ABS_BRAKE),
    ),
    # xpadneo over Bluetooth has the layout of xpad, which drives a pad on a cable.
    PadMap("Xbox, xpadneo", (BLUETOOTH,), MICROSOFT, declares=(ABS_RY, ABS_Z, ABS_RZ), arm=_XBOX_ARM),
    PadMap("Xbox", (USB, XONE), MICROSOFT, declares=(ABS_RY, ABS_Z, ABS_RZ), arm=_XBOX_ARM),
    # hid-sony, and hid-playstation since Linux 6.2. With hid-generic, ABS_RX is a trigger, whose rest would turn the robot.
    PadMap(
        "DualShock 4 or DualSense",
        (USB, BLUETOOTH),
        SONY,
        products=(0x05C4, 0x09CC, 0x0BA0, 0x0CE6, 0x0DF2),
        version_bits=KERNEL_LAYOUT,
        declares=(ABS_RY, ABS_Z, ABS_RZ),
        axis_range=UNSIGNED_8,
        arm=ArmControls(trigger_range=UNSIGNED_8),
    ),
    # hid-nintendo
    PadMap(
        "Switch Pro",
        (USB, BLUETOOTH),
        NINTENDO,
        products=(0x2009,),
        version_bits=KERNEL_LAYOUT,
        declares=(ABS_RY,),
        axis_range=(-32767, 32767),
        arm=ArmControls(open=BTN_TR2, close=BTN_TL2, trigger_range=None),
    ),
)


def find_map(found: PadId, maps: Sequence[PadMap] = MAPS) -> PadMap | None:
    """Return the row of a device, or None if it is no known pad."""
    return next((row for row in maps if row.fits(found)), None)


def is_wired(found: PadId) -> bool:
    """Return whether a device is on a cable, so that the kernel notices at once when the pad is gone."""
    return found.bus == USB and (found.vendor, found.product) not in _RECEIVERS


def parse_bits(text: str) -> frozenset[int]:
    """Return the numbers of the bits in a bitmap of sysfs: hexadecimal words as wide as a long, the highest one first.

    Raises ValueError for other text.
    """
    words = [int(word, 16) for word in reversed(text.split())]
    return frozenset(index * LONG_BITS + bit for index, word in enumerate(words) for bit in range(LONG_BITS) if word >> bit & 1)
