"""A planar velocity, its serialized form, and the hard limits of every command.

The drive bus forwards serialized messages, because building and serializing Python message objects would cost more than all its
other work. A geometry_msgs/Twist is six doubles after the four bytes of the CDR encapsulation header
(OMG DDSI-RTPS 2.2, 10.2), whose second byte is odd for little-endian.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import NamedTuple

CDR_TWIST_BYTES = 4 + 6 * 8

_LITTLE = struct.Struct("<6d")
_BIG = struct.Struct(">6d")
_HEADER = b"\x00\x01\x00\x00"


class Twist(NamedTuple):
    """A velocity of the base in its own frame: x forward, y left (m/s), yaw counter-clockwise (rad/s)."""

    x: float
    y: float
    yaw: float

    def is_finite(self) -> bool:
        """Return whether no component is NaN or infinite."""
        return math.isfinite(self.x) and math.isfinite(self.y) and math.isfinite(self.yaw)

    def is_neutral(self, tolerance: float = 1e-3) -> bool:
        """Return whether every component is within `tolerance` of zero, so that the base stands still. NaN is not neutral."""
        return abs(self.x) <= tolerance and abs(self.y) <= tolerance and abs(self.yaw) <= tolerance


ZERO = Twist(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class HardLimits:
    """The largest command that reaches the base, from any source.

    The defaults are the largest values that any source is configured for: the gamepad's turbo speed and navigation's turn rate.
    """

    linear_mps: float = 0.6
    yaw_radps: float = 1.9

    def clamp(self, twist: Twist) -> Twist:
        """Limit `twist`. x and y are scaled together, which keeps the direction of travel."""
        fastest = max(abs(twist.x), abs(twist.y))
        yaw = min(self.yaw_radps, max(-self.yaw_radps, twist.yaw))
        if fastest <= self.linear_mps:
            return twist if yaw == twist.yaw else Twist(twist.x, twist.y, yaw)
        scale = self.linear_mps / fastest
        return Twist(twist.x * scale, twist.y * scale, yaw)


def decode(data: bytes) -> Twist | None:
    """Return the planar velocity of a serialized geometry_msgs/Twist; its z, roll and pitch are dropped.

    Returns None for too few bytes, or if any of the six numbers is not finite.
    """
    if len(data) < CDR_TWIST_BYTES:
        return None
    x, y, z, roll, pitch, yaw = (_LITTLE if data[1] & 1 else _BIG).unpack_from(data, 4)
    # The sum is finite only if all six are: opposite infinities add up to NaN.
    return Twist(x, y, yaw) if math.isfinite(x + y + z + roll + pitch + yaw) else None


def encode(twist: Twist) -> bytes:
    """Serialize `twist` as a geometry_msgs/Twist, little-endian."""
    return _HEADER + _LITTLE.pack(twist.x, twist.y, 0.0, 0.0, 0.0, twist.yaw)
