"""Driving from a terminal: keys, and the gamepads of this computer if the run does not read them itself."""

from __future__ import annotations

import os
import select
import sys
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from lupin_cli.run.live_view import Repainter
from lupin_cli.run.pad_test import rates_text, velocity_text
from lupin_cli.run.ros_client import RosSession
from lupin_cli.safe_console import SafeConsole
from lupin_runtime import graph
from lupin_runtime.drive import ZERO, Twist, encode
from lupin_runtime.json_text import conform, parse_json
from lupin_runtime.teleop import connected_pads
from lupin_runtime.teleop.arm_jogger import AT_REST, ArmJogger
from lupin_runtime.teleop.connected_pads import SCAN_PERIOD_S, ConnectedPads
from lupin_runtime.teleop.jog_publisher import JogPublisher
from lupin_runtime.teleop.keyboard import HOLD_S, KeyboardDriver, is_end, split_keys
from lupin_runtime.teleop.map_files import map_folder
from lupin_runtime.teleop.pad_driver import PadDriver

HELP = "w s a d drive, q e turn, capital letters are faster, space stops, x ends"
STEP_S = 0.02
PAINT_PERIOD_S = 0.2
MAX_BYTES = 1024
STATUS_SILENT_S = 3.0
_STATUS = {"locks": [""], "winner": "", "inputs": {}}
_ARM_STATUS = {"holder": "", "jogged_by": "", "jog_refusal": "", "moving": False, "limp": False, "alarms": [""]}


class TeleopSession:
    """Sends what keys and pads command, and knows what drive bus and arm make of it. Times are ns of the monotonic clock."""

    def __init__(self, node: Any, *, reads_pads: bool) -> None:
        """`node` is a LupinNode on the graph of the run."""
        self.keyboard, self.pad_driver, self.arm_jogger = KeyboardDriver(), PadDriver(), ArmJogger()
        self.pads = (
            ConnectedPads(connected_pads.DEVICES, connected_pads.SYSFS, maps=map_folder(), inform=self._keep, warn=self._keep)
            if reads_pads
            else None
        )
        self.pad_velocity: Twist | None = None
        self.told = "the run reads the gamepads" if self.pads is None else "no gamepad is connected"
        self.status: dict[str, Any] = {}
        self.arm_status: dict[str, Any] = {}
        self._status_s = self._arm_status_s = 0.0
        self._scan_ns = 0
        self._by_keys = node.publisher(graph.CMD_VEL_MANUAL)
        self._by_pads = node.publisher(graph.CMD_VEL_JOY) if reads_pads else None
        self._rates = JogPublisher(node) if reads_pads else None
        node.subscription(graph.DRIVE_STATUS, self._on_status)
        node.subscription(graph.ARM_STATUS, self._on_arm_status)

    def step(self, keys: list[str], now_ns: int) -> None:
        """Handle the keys that were pressed, read the pads, and send what is due."""
        for key in keys:
            self.keyboard.press(key, now_ns)
        self._send(self._by_keys, self.keyboard.step(now_ns))
        if self.pads is None or self._rates is None:
            return
        if now_ns >= self._scan_ns:
            self.pads.scan(now_ns)
            self._scan_ns = now_ns + int(SCAN_PERIOD_S * 1e9)
        self.pads.read(now_ns)
        sent = self.pad_driver.step(self.pads.states, now_ns)
        self.pad_velocity = sent or self.pad_velocity if self.pad_driver.driving else None
        self._send(self._by_pads, sent)
        self._rates.publish(self.arm_jogger.step(self.pads.states, self.pad_driver.driving, now_ns))

    def close(self) -> None:
        """Stop what is driven from here."""
        if self.keyboard.velocity is not None:
            self._send(self._by_keys, ZERO)
        if self.pads is not None:
            if self.pad_driver.driving is not None:
                self._send(self._by_pads, ZERO)
            if self.arm_jogger.jogging is not None and self._rates is not None:
                self._rates.publish([AT_REST])
            self.pads.close()

    def view(self) -> RenderableType:
        """Return what is sent, what drives the robot, and what moves its arm."""
        table = Table.grid(padding=(0, 2))
        table.add_column(style="dim", no_wrap=True)
        table.add_column()
        keys, pad = self.keyboard.velocity, self.pad_velocity
        table.add_row("keys", _sent_text(keys, HELP))
        jogs = self.arm_jogger.jogging is not None
        table.add_row("gamepad", self._rates_text() if jogs else _sent_text(pad, self.told))
        table.add_row("drive bus", self._bus_text())
        for name, state in self.status.get("inputs", {}).items():
            table.add_row(f"  {name}", Text(conform(state, {"why": ""})["why"], style="dim"))
        table.add_row("arm", self._arm_text())
        for alarm in self.arm_status.get("alarms", []):
            table.add_row("", Text(alarm, style="bold red"))
        return table

    def _rates_text(self) -> Text:
        return Text(f"sends {rates_text(self.arm_jogger.rates)}", style="bold")

    def _arm_text(self) -> Text:
        status = self.arm_status
        if not status or time.monotonic() - self._arm_status_s > STATUS_SILENT_S:
            return Text("is silent; see what runs with: lupin status", style="bold red")
        if status["jog_refusal"]:
            return Text(f"is not moved by gamepad: {status['jog_refusal']}", style="bold red")
        if status["jogged_by"]:
            return Text(f"obeys {status['jogged_by']}")
        if status["limp"]:
            return Text("is limp")
        if status["holder"]:
            return Text(f"is reserved: {status['holder']}")
        return Text("moves" if status["moving"] else "at rest")

    def _bus_text(self) -> Text:
        if not self.status or time.monotonic() - self._status_s > STATUS_SILENT_S:
            return Text("is silent; see what runs with: lupin status", style="bold red")
        if self.status.get("locks"):
            return Text(f"locked: {', '.join(self.status['locks'])}", style="bold red")
        return Text(f"obeys {self.status['winner']}" if self.status.get("winner") else "at rest: no source drives")

    def _on_status(self, message: Any) -> None:
        with suppress(ValueError):  # another program's: the bus itself does not listen to this one
            self.status, self._status_s = conform(parse_json(message.data), _STATUS), time.monotonic()

    def _on_arm_status(self, message: Any) -> None:
        with suppress(ValueError):  # another program's
            self.arm_status, self._arm_status_s = conform(parse_json(message.data), _ARM_STATUS), time.monotonic()

    def _keep(self, text: str) -> None:
        self.told = text

    @staticmethod
    def _send(publisher: Any, velocity: Twist | None) -> None:
        if velocity is not None:
            publisher.publish(encode(velocity))


def _sent_text(velocity: Twist | None, otherwise: str) -> Text:
    return Text(otherwise, style="dim") if velocity is None else Text(f"sends {velocity_text(velocity)}", style="bold")


@contextmanager
def unbuffered_terminal() -> Iterator[None]:
    """Let the terminal pass on each key at once, also Ctrl-C, without showing it, for the block."""
    file = sys.stdin.fileno()
    before = termios.tcgetattr(file)
    try:
        tty.setraw(file, termios.TCSANOW)
        after = termios.tcgetattr(file)
        after[1] |= termios.OPOST  # line feeds still return to the first column
        termios.tcsetattr(file, termios.TCSANOW, after)
        yield
    finally:
        with suppress(termios.error):  # the terminal is gone
            termios.tcsetattr(file, termios.TCSADRAIN, before)


def _read_terminal() -> bytes:
    """Return what was typed; empty if the terminal is gone."""
    try:
        return os.read(sys.stdin.fileno(), MAX_BYTES)
    except OSError:
        return b""


def _read_keys(is_late: bool) -> list[str] | None:
    """Return the keys that wait to be read; None if one of them ends the driving, or the terminal is gone.

    `is_late`: this process was held up, so they may have been typed long ago, and only those count that end the driving.
    """
    while select.select([sys.stdin], [], [], 0.0)[0]:
        data = _read_terminal()
        if not data or is_end(data):
            return None
        if not is_late:
            return split_keys(data.decode(errors="replace"))
    return []


def drive(session: RosSession, *, reads_pads: bool) -> None:
    """Drive until a key ends it or the terminal is closed. If the terminal does not take the view, nothing is sent."""
    teleop, paint_at, read_s = TeleopSession(session.node, reads_pads=reads_pads), 0.0, time.monotonic()
    try:
        with unbuffered_terminal(), Repainter(SafeConsole()) as repainter:
            while True:
                select.select([sys.stdin], [], [], STEP_S)
                was_read_s, read_s = read_s, time.monotonic()
                keys = _read_keys(is_late=read_s - was_read_s > HOLD_S)
                if keys is None:
                    return
                session.handle_waiting()
                teleop.step(keys, time.monotonic_ns())
                if time.monotonic() >= paint_at:
                    repainter.paint(teleop.view())
                    paint_at = time.monotonic() + PAINT_PERIOD_S
    finally:
        teleop.close()
