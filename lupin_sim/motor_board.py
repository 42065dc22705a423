"""A simulated motor board behind a pseudo-terminal: it speaks Telemetrix, as the Pico's firmware does, and can be broken."""

from __future__ import annotations

import os
import select
import threading
import tty
from enum import Enum
from types import TracebackType

from lupin_runtime.board_protocol import ENCODER, FIRMWARE, LOOP_BACK, UNIQUE_ID, encode

SET_PIN_MODE, DIGITAL_WRITE, PWM_WRITE, RESET, ENCODER_NEW, PING, FEATURE = 1, 2, 3, 18, 30, 32, 37
MOVING = frozenset({SET_PIN_MODE, DIGITAL_WRITE, PWM_WRITE})  # requests that can turn a motor
MAX_REQUEST, MAX_ENCODERS = 30, 4  # of the firmware
WITH_FEATURES = (1, 3)  # an older firmware has no such request, and is lost if it gets one
BOARD_ID = bytes.fromhex("e661640843851c2d")
PAUSE_S = 0.1  # so long the firmware waits for the rest of a frame
_HUNG_UP_S = 0.02


class BoardFault(str, Enum):
    """What is wrong with the board."""

    NONE = "none"
    SILENT = "silent"  # it hangs: the port opens, and nothing answers
    ENCODERS_SILENT = "encoders-silent"  # it answers, and wheels that turn are not reported
    LATE = "late"  # it answers after `delay_s`
    GARBAGE = "garbage"  # every byte that it sends is damaged
    FOREIGN = "foreign"  # another program runs on it: it echoes what it gets behind a prompt


class Firmware:
    """The board's program, without a port: bytes in, bytes out.

    `requests` are the ids of all requests that it has obeyed, `stuck` says whether one has crashed it.
    """

    def __init__(self, version: tuple[int, int] = (1, 3), fault: BoardFault = BoardFault.NONE) -> None:
        self.version = version
        self.fault = fault
        self.requests: list[int] = []
        self.encoders: list[int] = []  # pins
        self.stuck = False
        self._frame: bytearray | None = None
        self._remaining = 0

    def receive(self, data: bytes) -> bytes:
        """Obey what arrives on the port. Return what the board sends."""
        if self.fault is BoardFault.FOREIGN:
            return b">>> " + data + b"\r\n"
        return b"".join(self._obey(frame) for byte in data if (frame := self._collect(byte)) is not None)

    def turn_wheel(self, pin: int, steps: int) -> bytes:
        """Let the encoder at `pin` count -128 to 127 steps. Return what the board reports."""
        if self.stuck or pin not in self.encoders or self.fault in (BoardFault.SILENT, BoardFault.ENCODERS_SILENT):
            return b""
        return self._damaged(encode(ENCODER, bytes((pin, steps & 0xFF))))

    def end_pause(self) -> None:
        """Forget half a frame, as the firmware does when no byte arrives for `PAUSE_S`."""
        self._frame = None

    def _collect(self, byte: int) -> bytes | None:
        """Add a byte. Return the frame that it completes, without its length."""
        if self._frame is None:
            if 0 < byte <= MAX_REQUEST:
                self._frame, self._remaining = bytearray(), byte
            return None
        self._frame.append(byte)
        self._remaining -= 1
        if self._remaining:
            return None
        frame, self._frame = bytes(self._frame), None
        return frame

    def _obey(self, frame: bytes) -> bytes:
        if self.fault is BoardFault.SILENT or self.stuck:
            return b""
        request, data = frame[0], frame[1:].ljust(MAX_REQUEST, b"\0")
        self.requests.append(request)
        if request == FEATURE and self.version < WITH_FEATURES:
            self.stuck = True
        elif request == ENCODER_NEW and len(self.encoders) < MAX_ENCODERS:
            self.encoders.append(data[1])
        elif request == RESET:
            self.encoders.clear()
        return self._damaged(self._answer(request, data))

    def _answer(self, request: int, data: bytes) -> bytes:
        if request == LOOP_BACK:
            return encode(LOOP_BACK, data[:1])
        if request == FIRMWARE:
            return encode(FIRMWARE, bytes(self.version))
        if request == UNIQUE_ID:
            return encode(UNIQUE_ID, BOARD_ID)
        if request == PING:
            return encode(PING, bytes((data[0], 42)))
        if request == FEATURE and not self.stuck:
            return encode(FEATURE, bytes((data[0], int(data[0] <= FEATURE))))
        return b""

    def _damaged(self, sent: bytes) -> bytes:
        return bytes(byte ^ 0xFF for byte in sent) if self.fault is BoardFault.GARBAGE else sent


class SimulatedBoard:
    """The firmware behind a pseudo-terminal, whose path is `port`, until it is closed; closing it is pulling its plug."""

    def __init__(self, firmware: Firmware, delay_s: float = 0.0) -> None:
        self.firmware = firmware
        self._delay_s = delay_s if firmware.fault is BoardFault.LATE else 0.0
        self._plug, port = os.openpty()
        os.set_blocking(self._plug, False)  # it seems readable while nobody has the port open, and then is not
        tty.setraw(port)  # the kernel keeps this for as long as the plug is open
        self.port = os.ttyname(port)
        os.close(port)  # the port must look unused
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="motor board")
        self._thread.start()

    def __enter__(self) -> SimulatedBoard:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Unplug the board. A second call does nothing."""
        if not self._closed.is_set():
            self._closed.set()
            self._thread.join()
            os.close(self._plug)

    def send(self, data: bytes) -> None:
        """Send bytes of the board's own accord, as reports are."""
        os.write(self._plug, data)

    def _serve(self) -> None:
        while not self._closed.is_set():
            readable = select.select([self._plug], [], [], PAUSE_S)[0]
            try:
                data = os.read(self._plug, 4096) if readable else b""
            except OSError:  # nobody has the port open, or opened it just now
                self._closed.wait(_HUNG_UP_S)
                data = b""
            if not data:
                self.firmware.end_pause()
                continue
            sent = self.firmware.receive(data)
            if sent and not self._closed.wait(self._delay_s):
                os.write(self._plug, sent)
