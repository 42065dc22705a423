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
from pathlib import Path

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.cameras.configuration import CONFIGURATION, CameraConfiguration, read_configuration
from lupin_runtime.cameras.devices import BODY, GRIPPER, Camera, find_camera, is_enabled
from lupin_runtime.cameras.holders import end, find_holders
from lupin_runtime.ros.supervision import end_with_parent

LOOK_S = 2.0
AGAIN_S = 4.0  # a driver that ends at once must not fill the journal
_ENDING = ((signal.SIGINT, 4.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 2.0))


class CameraDriver:
    """Keeps a camera's driver running until `ended` is set. `root` is where /dev and /sys are."""

    def __init__(self, kind: str, configuration: CameraConfiguration, ended: threading.Event, root: Path = Path("/")) -> None:
        self._kind, self._configuration, self._ended, self._root = kind, configuration, ended, root
        self._said = ""

    def run(self) -> None:
        """Run."""
        if not is_enabled(self._kind, self._configuration):
            self._say(f"the {self._kind} camera is switched off in {CONFIGURATION}")
            self._ended.wait()
        while not self._ended.is_set():
            camera = find_camera(self._kind, self._configuration, self._root)
            if camera is None:
                self._say(f"no {self._kind} camera is connected")
                self._ended.wait(LOOK_S)
            elif self._free(camera):
                self._drive(camera)
            else:
                self._ended.wait(LOOK_S)

    def _free(self, camera: Camera) -> bool:
        """End the drivers that hold the camera; False where somebody else holds it, whom nobody but a person may end."""
        for holder in find_holders(camera.devices):
            if not holder.is_driver:
                self._say(f"the {self._kind} camera is held by {holder}, which is no camera driver; end it: kill {holder.pid}")
                return False
            self._say(f"ending {holder}")
            if not end(holder):
                self._say(f"{holder} did not end")
                return False
        return True

    def _drive(self, camera: Camera) -> None:
        try:
            # In a session of its own, because the ros2 command passes no signal on to the driver.
            process = subprocess.Popen(camera.command, stdin=subprocess.DEVNULL, start_new_session=True)
        except OSError as error:
            self._say(f"{camera.command[0]} cannot be started: {error.strerror}; is the vendor's workspace sourced?")
            self._ended.wait(AGAIN_S)
            return
        self._say(f"started: {' '.join(camera.command)}")
        while process.poll() is None and not self._ended.wait(0.2):
            pass
        _end_group(process)
        if not self._ended.is_set():
            self._say(f"the driver of the {self._kind} camera ended with status {process.returncode}")
            self._ended.wait(AGAIN_S)

    def _say(self, text: str) -> None:
        """Print what is new."""
        if text != self._said:
            print(text, flush=True)
        self._said = text


def _end_group(process: subprocess.Popen[bytes]) -> None:
    """End a driver and all that it has started."""
    for number, bound_s in _ENDING:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(bound_s)
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
