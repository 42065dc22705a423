"""Runs the vendor's driver of one of the robot's cameras: `python -m lupin_runtime.cameras.driver body|gripper`.

It waits for the camera, ends vendor processes that hold it, and starts the driver again when that ends, as it does when the
camera is unplugged. It ends on SIGTERM.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.cameras.configuration import CONFIGURATION, CameraConfiguration, read_configuration
from lupin_runtime.cameras.devices import BODY, GRIPPER, Camera, find_camera, is_enabled
from lupin_runtime.cameras.driver_state import ABSENT, ENDED, HELD, NO_DRIVER, OFF, RUNNING, DriverState, write_state
from lupin_runtime.cameras.holders import end, find_holders
from lupin_runtime.ros.supervision import end_with_parent

LOOK_S = 2.0
AGAIN_S = 4.0  # a driver that ends at once must not fill the journal
STEADY_S = 10.0  # a driver that ran for this long has not failed again
_ENDING = ((signal.SIGINT, 4.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 2.0))


class CameraDriver:
    """Keeps a camera's driver running until `ended` is set. `root` is where /dev and /sys are."""

    def __init__(self, kind: str, configuration: CameraConfiguration, ended: threading.Event, root: Path = Path("/")) -> None:
        self._kind, self._configuration, self._ended, self._root = kind, configuration, ended, root
        self._reported: DriverState | None = None
        self._ends = 0  # of drivers that ended by themselves, one after the other

    def run(self) -> None:
        """Run."""
        if not is_enabled(self._kind, self._configuration):
            self._report(OFF, f"the {self._kind} camera is switched off in {CONFIGURATION}")
            self._ended.wait()
        while not self._ended.is_set():
            camera = find_camera(self._kind, self._configuration, self._root)
            if camera is None:
                self._ends = 0
                self._report(ABSENT, f"no {self._kind} camera is connected")
                self._ended.wait(LOOK_S)
            elif self._free(camera):
                self._drive(camera)
            else:
                self._ended.wait(LOOK_S)

    def _free(self, camera: Camera) -> bool:
        """End the drivers that hold the camera; False where somebody else holds it, whom nobody but a person may end."""
        for holder in find_holders(camera.devices):
            if not holder.is_driver:
                text = f"the {self._kind} camera is held by {holder} and is no camera driver; end it: kill {holder.pid}"
                self._report(HELD, text)
                return False
            print(f"ending {holder}", flush=True)
            if not end(holder):
                self._report(HELD, f"the {self._kind} camera is held by {holder} and did not end")
                return False
        return True

    def _drive(self, camera: Camera) -> None:
        try:
            # In a session of its own, because the ros2 command passes no signal on to the driver.
            process = subprocess.Popen(camera.command, stdin=subprocess.DEVNULL, start_new_session=True)
        except OSError as error:
            self._report(
                NO_DRIVER, f"{camera.command[0]} cannot be started: {error.strerror}; is the vendor's workspace sourced?"
            )
            self._ended.wait(AGAIN_S)
            return
        print(f"started: {' '.join(camera.command)}", flush=True)
        started_s = time.monotonic()
        while process.poll() is None and not self._ended.wait(0.2):
            if not self._ends or time.monotonic() - started_s > STEADY_S:
                self._ends = 0
                self._report(RUNNING, f"the driver of the {self._kind} camera runs")
        _end_group(process)
        if not self._ended.is_set():
            self._ends += 1
            times = f", {self._ends} times in a row" if self._ends > 1 else ""
            self._report(ENDED, f"the driver of the {self._kind} camera ended with status {process.returncode}{times}")
            self._ended.wait(AGAIN_S)

    def _report(self, state: str, text: str) -> None:
        """Print what is new, and keep it for the doctor."""
        new = DriverState(state, text, self._ends)
        if new != self._reported:
            print(text, flush=True)
            write_state(self._kind, new)
        self._reported = new


def _end_group(process: subprocess.Popen[bytes]) -> None:
    """End a driver and all that it has started."""
    for number, timeout_s in _ENDING:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout_s)
            break
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def main(kind: str) -> int:
    """Run until SIGTERM; returns the exit status."""
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    end_with_parent()
    try:
        configuration = read_configuration()
    except (MalformedFile, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    CameraDriver(kind, configuration, ended).run()
    return 0


if __name__ == "__main__":
    if sys.argv[1:] not in ([BODY], [GRIPPER]):
        print(f"usage: python -m lupin_runtime.cameras.driver {BODY}|{GRIPPER}", file=sys.stderr)
        sys.exit(2)
    sys.exit(main(sys.argv[1]))
