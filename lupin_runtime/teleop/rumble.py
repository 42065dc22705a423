"""Lets a gamepad rumble when the robot does not do what its operator expects. A gamepad that cannot rumble is no error."""

from __future__ import annotations

import enum
import errno
import fcntl
import os
import struct
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from pathlib import Path

from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED
from lupin_runtime.teleop.events import Event, encode_event

REPEAT_S = 1.0  # of a command that is refused
LOST_S = 5.0  # of silence of the drive bus, which repeats its status every second, a few times as slowly in a slow simulation


class Alert(enum.Enum):
    """What an operator is told of, with the strength (0..1) and the length (s) of the rumble."""

    STOPPED = (1.0, 0.6)  # the e-stop was engaged
    REFUSED = (0.5, 0.2)  # the dead-man button is held while the drive bus is locked, or the arm's node refuses the jog
    LOST = (1.0, 1.0)  # the drive bus is not heard any more


class AlertRules:
    """Decides when to alert. Times are nanoseconds of the monotonic clock."""

    def __init__(self) -> None:
        self._locks: Collection[str] = ()
        self._jog_refusal = ""
        self._heard_ns: int | None = None
        self._stopped = False  # whether the e-stop was engaged since the last alert
        self._refused_ns: int | None = None

    def handle_status(self, locks: Collection[str], now_ns: int) -> None:
        """Handle the locks of the drive bus."""
        self._stopped = ESTOP_ENGAGED in locks and (self._stopped or ESTOP_ENGAGED not in self._locks)
        self._locks, self._heard_ns = locks, now_ns

    def handle_arm(self, jog_refusal: str) -> None:
        """Handle the arm's status: why what a pad commands is refused, or empty."""
        self._jog_refusal = jog_refusal

    def step(self, held: bool, now_ns: int, jogging: bool = False) -> Alert | None:
        """Return what to tell now, or None.

        `held` and `jogging`: whether the dead-man button of a gamepad counts as held, and whether one moves the arm.
        """
        if self._heard_ns is not None and now_ns - self._heard_ns > LOST_S * 1e9:
            self._heard_ns, self._locks = None, ()
            return Alert.LOST
        if self._stopped:
            self._stopped, self._refused_ns = False, now_ns
            return Alert.STOPPED
        if not (held and self._locks) and not (jogging and self._jog_refusal):
            self._refused_ns = None
        elif self._refused_ns is None or now_ns - self._refused_ns >= REPEAT_S * 1e9:
            self._refused_ns = now_ns
            return Alert.REFUSED
        return None


# struct ff_effect of linux/input.h: type, id, direction, trigger button and interval, length (ms) and delay, and a union whose
# largest member ends in a pointer. A rumble has two strengths there.
_EFFECT = struct.Struct("@HhHHHHH0P")
_UNION_BYTES = struct.calcsize("@9HIP")
_STRENGTHS = struct.Struct("@HH")
_EFFECT_BYTES = _EFFECT.size + _UNION_BYTES
_VIRTUAL = Path("/sys/devices/virtual/input")  # of uinput; Bluetooth has other folders
_EV_FF, _FF_RUMBLE = 0x15, 0x50
_UPLOAD = 0x4000_4580 | _EFFECT_BYTES << 16  # EVIOCSFF


def encode_rumble(alert: Alert) -> bytearray:
    """Return the effect of an alert, as the kernel takes it; the kernel writes its number into it."""
    strength, length_s = alert.value
    both = round(strength * 0xFFFF)
    effect = bytearray(_EFFECT_BYTES)
    _EFFECT.pack_into(effect, 0, _FF_RUMBLE, -1, 0, 0, 0, round(length_s * 1000), 0)
    _STRENGTHS.pack_into(effect, _EFFECT.size, both, both)
    return effect


class Rumbles:
    """The effects of the connected pads that can rumble, by the names of their devices."""

    def __init__(self, devices: Path, sysfs: Path, inform: Callable[[str], object]) -> None:
        """`inform` is told once of each pad that cannot rumble."""
        self._devices, self._sysfs, self._inform = devices, sysfs, inform
        self._files: dict[str, int | None] = {}  # None: it cannot rumble
        self._numbers: dict[tuple[str, Alert], int] = {}

    def follow(self, names: Iterable[str]) -> None:
        """Prepare the effects of new pads, and drop those of pads that are gone."""
        current = set(names)
        for gone in self._files.keys() - current:
            self._close(gone)
        for name in current - self._files.keys():
            self._files[name] = None
            try:
                self._open(name)
            except OSError as error:
                self._fail(name, error)

    def play(self, alert: Alert) -> None:
        """Let all pads rumble."""
        for name, file in tuple(self._files.items()):
            if file is not None:
                try:
                    os.write(file, encode_event(Event(0, _EV_FF, self._numbers[name, alert], 1)))
                except OSError as error:
                    self._fail(name, error)

    def close(self) -> None:
        """Drop all effects."""
        self.follow(())

    def _open(self, name: str) -> None:
        if _VIRTUAL in (self._sysfs / name).resolve().parents:
            # The program that made it answers each request, or lets this one wait for half a minute.
            raise OSError(errno.EOPNOTSUPP, "it is made by a program")
        # A file of its own: without the right to write, a pad can still drive.
        file = os.open(self._devices / name, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        self._files[name] = file
        for alert in Alert:
            effect = encode_rumble(alert)
            fcntl.ioctl(file, _UPLOAD, effect)
            self._numbers[name, alert] = _EFFECT.unpack_from(effect)[1]

    def _fail(self, name: str, error: OSError) -> None:
        self._inform(f"{name} does not rumble: {error.strerror}")
        self._close(name)
        self._files[name] = None

    def _close(self, name: str) -> None:
        file = self._files.pop(name)
        if file is not None:
            with suppress(OSError):  # it is gone
                os.close(file)
