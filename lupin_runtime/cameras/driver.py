"""Runs the vendor's driver of one of the robot's cameras: `python -m lupin_runtime.cameras.driver body|gripper`.

It waits for the camera, terminates the vendor's own drivers that hold it, and restarts the driver whenever that exits, for
example because the camera was unplugged. It exits on SIGTERM.
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
from lupin_runtime.cameras.holders import find_holders, terminate
from lupin_runtime.exit_codes import SUCCESS, USAGE_ERROR
from lupin_runtime.ros.supervision import end_with_parent

CAMERA_CHECK_PERIOD_S = 2.0
RESTART_DELAY_S = 4.0  # so that a driver that exits immediately does not fill the system journal
STABLE_AFTER_S = 10.0  # a driver that has run for this long works: the count of its exits starts again
_SIGNALS = ((signal.SIGINT, 4.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 2.0))  # each with the wait in s that follows


class CameraDriver:
    """Keeps a camera's driver running until `stopping` is set. `root` is the folder that contains /dev and /sys."""

    def __init__(
        self, kind: str, configuration: CameraConfiguration, stopping: threading.Event, root: Path = Path("/")
    ) -> None:
        self._kind, self._configuration, self._stopping, self._root = kind, configuration, stopping, root
        self._reported: DriverState | None = None
        self._exits = 0  # how often in a row the driver exited by itself

    def run(self) -> None:
        """Run until `stopping` is set."""
        if not is_enabled(self._kind, self._configuration):
            self._report(OFF, f"the {self._kind} camera is switched off in {CONFIGURATION}")
            self._stopping.wait()
        while not self._stopping.is_set():
            camera = find_camera(self._kind, self._configuration, self._root)
            if camera is None:
                self._exits = 0
                self._report(ABSENT, f"no {self._kind} camera is connected")
                self._stopping.wait(CAMERA_CHECK_PERIOD_S)
            elif self._free(camera):
                self._run_driver(camera)
            else:
                self._stopping.wait(CAMERA_CHECK_PERIOD_S)

    def _free(self, camera: Camera) -> bool:
        """Terminate the vendor's drivers that hold the camera.

        Returns False if one of them does not exit, or if another program holds the camera, which only a person may terminate.
        """
        for holder in find_holders(camera.devices):
            if not holder.is_driver:
                text = f"the {self._kind} camera is held by {holder} and is not a camera driver; stop it: kill {holder.pid}"
                self._report(HELD, text)
                return False
            print(f"terminating {holder}", flush=True)
            if not terminate(holder):
                self._report(HELD, f"the {self._kind} camera is held by {holder} and did not exit")
                return False
        return True

    def _run_driver(self, camera: Camera) -> None:
        try:
            # In its own session, so that the whole group can be signaled: the ros2 command forwards no signal to the driver.
            process = subprocess.Popen(camera.command, stdin=subprocess.DEVNULL, start_new_session=True)
        except OSError as error:
            self._report(
                NO_DRIVER, f"{camera.command[0]} cannot be started: {error.strerror}; is the vendor's workspace sourced?"
            )
            self._stopping.wait(RESTART_DELAY_S)
            return
        print(f"started: {' '.join(camera.command)}", flush=True)
        started_s = time.monotonic()
        while process.poll() is None and not self._stopping.wait(0.2):
            if not self._exits or time.monotonic() - started_s > STABLE_AFTER_S:
                self._exits = 0
                self._report(RUNNING, f"the driver of the {self._kind} camera runs")
        _terminate_group(process)
        if not self._stopping.is_set():
            self._exits += 1
            times = f", {self._exits} times in a row" if self._exits > 1 else ""
            self._report(ENDED, f"the driver of the {self._kind} camera exited with status {process.returncode}{times}")
            self._stopping.wait(RESTART_DELAY_S)

    def _report(self, state: str, text: str) -> None:
        """If the state has changed, print it and write it to the file that the doctor reads."""
        new = DriverState(state, text, self._exits)
        if new != self._reported:
            print(text, flush=True)
            write_state(self._kind, new)
        self._reported = new


def _terminate_group(process: subprocess.Popen[bytes]) -> None:
    """Terminate a driver and all processes that it has started."""
    for number, timeout_s in _SIGNALS:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout_s)
            break
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def main(kind: str) -> int:
    """Run until SIGTERM; returns the exit status."""
    stopping = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stopping.set())
    end_with_parent()
    try:
        configuration = read_configuration()
    except (MalformedFile, OSError) as error:
        print(error, file=sys.stderr)
        return USAGE_ERROR
    CameraDriver(kind, configuration, stopping).run()
    return SUCCESS


if __name__ == "__main__":
    if sys.argv[1:] not in ([BODY], [GRIPPER]):
        print(f"usage: python -m lupin_runtime.cameras.driver {BODY}|{GRIPPER}", file=sys.stderr)
        sys.exit(USAGE_ERROR)
    sys.exit(main(sys.argv[1]))
