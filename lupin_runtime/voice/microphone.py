"""Records the microphone of this computer by arecord, which ends with the block that opened it."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator

from lupin_runtime.voice.endpointer import FRAME_BYTES, SAMPLE_RATE_HZ
from lupin_runtime.voice.speech import SpeechUnavailable

MISSING_ARECORD = "the microphone needs arecord, which is not installed; type: sudo apt install alsa-utils, or use --text"
LOST = "the microphone is lost: {reason}; see those that are there with: arecord -l, or use --text"
START_TIMEOUT_S = 10.0  # to the first frame
MAX_GAP_S = 2.0  # between two frames; some devices that were unplugged end nothing
_END_TIMEOUT_S = 2.0
_WATCH_PERIOD_S = 0.1


@contextlib.contextmanager
def open_microphone() -> Iterator[Iterator[bytes]]:
    """Yield an iterator of frames. Raises SpeechUnavailable if arecord is missing, and from the iterator once it ends."""
    program = shutil.which("arecord")
    if program is None:
        raise SpeechUnavailable(MISSING_ARECORD)
    command = [program, "-q", "-t", "raw", "-f", "S16_LE", "-r", str(SAMPLE_RATE_HZ), "-c", "1"]
    pipe = subprocess.PIPE
    # In a session of its own, Ctrl-C does not end it before this program: that is no loss of the microphone.
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, start_new_session=True)
    assert process.stdout is not None and process.stderr is not None
    try:
        yield _frames(process)
    finally:
        process.terminate()
        try:
            process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()
        process.stderr.close()


def _frames(process: subprocess.Popen[bytes]) -> Iterator[bytes]:
    assert process.stdout is not None
    watch = _Watch(process)
    try:
        while len(frame := watch.read(process.stdout.read)) == FRAME_BYTES:
            yield frame
    finally:
        watch.close()
    raise SpeechUnavailable(LOST.format(reason=watch.problem or _why_ended(process)))


def _why_ended(process: subprocess.Popen[bytes]) -> str:
    """Return why arecord has ended, as it is killed if it has only closed its output."""
    assert process.stderr is not None
    try:
        status = process.wait(_END_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        status = process.wait()
    reason = process.stderr.read().decode(errors="replace").strip().splitlines()[-1:]
    return "".join(reason) or f"arecord ended with {status}"


class _Watch:
    """Kills a recorder that has sent nothing for too long, so that a blocked read of its output ends."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.problem = ""
        self._process = process
        self._deadline_s: float | None = None  # of the present read
        self._limit_s = START_TIMEOUT_S
        self._closed = threading.Event()
        threading.Thread(target=self._run, name="lupin-microphone-watch", daemon=True).start()

    def read(self, read: Callable[[int], bytes]) -> bytes:
        """Read a frame; a shorter one is the last."""
        self._deadline_s = time.monotonic() + self._limit_s
        frame = read(FRAME_BYTES)
        self._deadline_s, self._limit_s = None, MAX_GAP_S
        return frame

    def close(self) -> None:
        """End the thread."""
        self._closed.set()

    def _run(self) -> None:
        while not self._closed.wait(_WATCH_PERIOD_S):
            deadline_s = self._deadline_s
            if deadline_s is not None and time.monotonic() > deadline_s:
                self.problem = f"it has sent nothing for {self._limit_s:g} s"
                self._process.kill()
                return
