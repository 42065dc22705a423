"""Shows what the gamepads of this computer send and what it means, without sending anything to the robot."""

from __future__ import annotations

import json
import select
import time

from lupin_cli.terminal import echo
from lupin_runtime.drive import Twist
from lupin_runtime.teleop import connected_pads
from lupin_runtime.teleop.arm_jogger import AT_REST, ArmJogger, ArmRates
from lupin_runtime.teleop.battery import battery_text
from lupin_runtime.teleop.connected_pads import SCAN_PERIOD_S, ConnectedPads
from lupin_runtime.teleop.events import EV_ABS, EV_KEY, Event
from lupin_runtime.teleop.map_files import map_folder
from lupin_runtime.teleop.pad_driver import PadDriver
from lupin_runtime.teleop.pad_selection import PERIOD_S

KINDS = {EV_KEY: "key", EV_ABS: "axis"}


def velocity_text(velocity: Twist) -> str:
    """Return a velocity in words."""
    x, y, yaw = (round(value, 2) + 0.0 for value in velocity)  # + 0.0: without a zero below zero
    return f"forward {x:.2f} m/s, left {y:.2f} m/s, turn left {yaw:.2f} rad/s"


def rates_text(rates: ArmRates) -> str:
    """Return the rates of the arm's joints that move in words."""
    moving = (f"{name} {rate:+.2f} rad/s" for name, rate in rates._asdict().items() if rate)
    return f"arm: {', '.join(moving) or 'at rest'}"


class PadTest:
    """Reads the pads, and prints the newest value of each control that has changed, at most 20 times a second."""

    def __init__(self, as_json: bool) -> None:
        self.found = False  # whether any pad was connected
        self._as_json = as_json
        self._pads = ConnectedPads(
            connected_pads.DEVICES,
            connected_pads.SYSFS,
            maps=map_folder(),
            inform=self._inform,
            warn=self._warn,
            observe=self._observe,
            drives=False,
        )
        self._driver, self._jogger = PadDriver(), ArmJogger()
        self._changed: dict[tuple[str, int, int], int] = {}
        self._velocity: Twist | None = None

    def run(self, seconds: float | None) -> None:
        """Print until `seconds` have passed, or until KeyboardInterrupt."""
        end = None if seconds is None else time.monotonic() + seconds
        scan_at = 0.0
        try:
            while end is None or time.monotonic() < end:
                if time.monotonic() >= scan_at:
                    self._scan()
                    scan_at = time.monotonic() + SCAN_PERIOD_S
                select.select([pad.device.file for pad in self._pads.pads.values()], [], [], PERIOD_S)
                time.sleep(PERIOD_S / 2)  # a pad sends up to 1000 reports a second: their last values are enough
                self._step(time.monotonic_ns())
        finally:
            self._pads.close()

    def _scan(self) -> None:
        known = set(self._pads.pads)
        self._pads.scan(time.monotonic_ns())
        for name in self._pads.pads.keys() - known:
            if charge := battery_text(connected_pads.SYSFS / name / "device"):
                echo(f"{self._pads.pads[name].label} has a battery: {charge}", err=True)

    def _step(self, now_ns: int) -> None:
        self._pads.read(now_ns)
        sent = self._driver.step(self._pads.states, now_ns)
        self._jogger.step(self._pads.states, self._driver.driving, now_ns)
        if self._driver.driving is None:
            self._velocity = None
        elif sent is not None:
            self._velocity = sent
        for (name, kind, code), value in self._changed.items():
            self._print(name, kind, code, value)
        self._changed.clear()

    def _observe(self, name: str, event: Event) -> None:
        if event.type in KINDS:
            self._changed[name, event.type, event.code] = event.value

    def _print(self, name: str, kind: int, code: int, value: int) -> None:
        pad = self._pads.pads.get(name)
        if pad is None:
            return
        control, dead_man = pad.state.row.control(kind, code), pad.state.dead_man.value
        velocity = self._velocity if self._driver.driving == name else None
        rates = self._jogger.rates if self._jogger.jogging == name else AT_REST
        if self._as_json:
            shown = {"pad": name, "kind": KINDS[kind], "code": code, "value": value, "control": control, "dead_man": dead_man}
            print(json.dumps({**shown, "velocity": velocity and velocity._asdict(), "arm": rates._asdict()}), flush=True)
            return
        would = "would send nothing"
        if rates != AT_REST:
            would = f"would send {rates_text(rates)}"
        elif velocity is not None:
            would = f"would send {velocity_text(velocity)}"
        echo(f"{name}  {KINDS[kind]} 0x{code:03x}  {value:7}  {control:16}  dead-man {dead_man:8}  {would}", wrap=False)

    def _inform(self, text: str) -> None:
        self.found = True
        echo(text, err=True)

    def _warn(self, text: str) -> None:
        echo(text, err=True)
