"""The connected pads: found by a look at the folder of the input devices, opened, read, and closed when they are gone."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.teleop.device import Device, read_identity, read_name
from lupin_runtime.teleop.events import Event
from lupin_runtime.teleop.map_files import map_path, read_map
from lupin_runtime.teleop.pad_maps import TRANSPORTS, PadMap, find_map, is_wired
from lupin_runtime.teleop.pad_state import QUIET_S, DeadMan, PadState

DEVICES = Path("/dev/input")
SYSFS = Path("/sys/class/input")
SCAN_PERIOD_S = 1.0
MAX_DEVICES = 64  # of the folder that are looked at

IN_USE = "it already drives for another run or in a terminal; end that, or start this run with: lupin up --no-joystick"
IN_USE_ON_ROBOT = "it already drives for another program of the robot; end that, which this names: sudo fuser -v {path}"
_GROUP_ADVICE_ON_ROBOT = "let this program open it, from a laptop: lupin deploy robot"
_GROUP_ADVICE = "add yourself to the group input, and log in again: sudo usermod -aG input $USER"


def input_devices(folder: Path) -> list[str]:
    """Return the names of the input devices; empty without any, as there is no folder then."""
    try:
        return sorted(path.name for path in folder.iterdir() if re.fullmatch(r"event\d+", path.name))[:MAX_DEVICES]
    except OSError:
        return []


@dataclass(frozen=True)
class Pad:
    """A connected pad: its device, its state, and what to call it."""

    device: Device
    state: PadState
    label: str


class ConnectedPads:
    """The connected pads by the names of their devices, such as event7. Times are nanoseconds of the monotonic clock."""

    def __init__(
        self,
        devices: Path = DEVICES,
        sysfs: Path = SYSFS,
        *,
        maps: Path | None = None,
        inform: Callable[[str], object],
        warn: Callable[[str], object],
        observe: Callable[[str, Event], object] = lambda *_: None,
        drives: bool = True,
        on_robot: bool = False,
    ) -> None:
        """Use the calibrated pads of the folder `maps`, too. A pad drives one robot: `drives` claims each for this program.
        `on_robot` selects the advice for a person on the robot.

        `inform` is told of pads that come and go, `warn` once of each that cannot be read; `observe` gets all events.
        """
        self.pads: dict[str, Pad] = {}
        self._devices, self._sysfs, self._maps = devices, sysfs, maps
        self._inform, self._warn, self._observe = inform, warn, observe
        self._drives, self._on_robot = drives, on_robot
        self._examined: dict[str, tuple[int, PadMap | None]] = {}  # by name: the file's number, and its row
        self._refusals: dict[str, int] = {}  # by name: how often the device could not be used in a row

    @property
    def states(self) -> dict[str, PadState]:
        """The states of the pads."""
        return {name: pad.state for name, pad in self.pads.items()}

    def scan(self, now_ns: int) -> None:
        """Open the pads that are new. Those that are gone are noticed by `read`."""
        names = input_devices(self._devices)
        for gone in self._examined.keys() - set(names):
            del self._examined[gone]
        for gone in self._refusals.keys() - set(names):
            del self._refusals[gone]
        for name in names:
            # A device that disappears meanwhile is no error. Half of one may be there: it is looked at again the next time.
            with suppress(OSError, ValueError):
                row = self._examine(name)
                if row is not None and name not in self.pads:
                    self._open(name, row, now_ns)

    def read(self, now_ns: int) -> None:
        """Read and handle the events of all pads; close those that are gone."""
        for name, pad in tuple(self.pads.items()):
            try:
                events = pad.device.read()
            except OSError:
                self.pads.pop(name).device.close()
                self._inform(f"{pad.label} is gone")
                continue
            pad.state.handle(events, now_ns)
            if problem := pad.state.take_problem():
                self._inform(f"{pad.label} {problem}: let go of its controls, and use them again")
            for event in events:
                self._observe(name, event)
            self._resynchronize(pad)

    def close(self) -> None:
        """Close all pads."""
        while self.pads:
            self.pads.popitem()[1].device.close()

    def _examine(self, name: str) -> PadMap | None:
        number = (self._devices / name).stat().st_ino
        known = self._examined.get(name)
        if known is not None and known[0] == number:
            return known[1]
        row = self._find_row(name)
        self._examined[name] = (number, row)
        return row

    def _find_row(self, name: str) -> PadMap | None:
        """Return the calibrated row of a device, or that of the table. With a broken file, a device is not used."""
        found = read_identity(self._sysfs / name / "device")
        if self._maps is None:
            return find_map(found)
        path = map_path(self._maps, found)
        try:
            return read_map(path, found) or find_map(found)
        except MalformedFile as error:
            problem = str(error)
        except OSError as error:
            problem = f"cannot read {path}: {error.strerror}"
        where = f", on a laptop, and copy {path.name} here" if self._on_robot else ""
        self._warn(f"{name} is not used: {problem}; calibrate it with: lupin teleop calibrate{where}")
        return None

    def _open(self, name: str, row: PadMap, now_ns: int) -> None:
        folder = self._sysfs / name / "device"
        found = read_identity(folder)
        label = f"{read_name(folder) or row.name} ({TRANSPORTS.get(found.bus, 'other')}, {name})"
        try:
            device = Device(self._devices / name)
        except FileNotFoundError:
            return
        except OSError as error:
            advice = _GROUP_ADVICE_ON_ROBOT if self._on_robot else _GROUP_ADVICE
            advice = f"; {advice}" if isinstance(error, PermissionError) else ""
            self._refuse(name, f"cannot read {label}: {error.strerror}{advice}")
            return
        if self._drives and not device.claim():
            device.close()
            advice = IN_USE_ON_ROBOT.format(path=self._devices / name) if self._on_robot else IN_USE
            self._refuse(name, f"{label} is not used: {advice}")
            return
        self._refusals.pop(name, None)
        quiet_s = None if is_wired(found) else QUIET_S
        pad = Pad(device, PadState(row, found.bus, device.ranges(row.ranges), now_ns, quiet_s=quiet_s), label)
        self._resynchronize(pad)
        self.pads[name] = pad
        self._inform(f"{label} is connected: hold its left shoulder button to drive")

    def _refuse(self, name: str, problem: str) -> None:
        """Tell of a device that cannot be used: once, and not at the first try, before udev has set who may read it."""
        self._refusals[name] = self._refusals.get(name, 0) + 1
        if self._refusals[name] == 2:
            self._warn(problem)

    def _resynchronize(self, pad: Pad) -> None:
        """Ask the kernel for a state that events do not tell, until the dead-man button is seen released."""
        if pad.state.dead_man is DeadMan.UNKNOWN:
            snapshot = pad.device.snapshot(pad.state.row.ranges)
            if snapshot is not None:
                pad.state.resynchronize(snapshot)
