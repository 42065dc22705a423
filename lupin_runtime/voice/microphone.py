"""Records the microphone of this computer by arecord, which ends with the block that opened it."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
from collections.abc import Iterator
from typing import IO

from lupin_runtime.voice.endpointer import FRAME_BYTES, SAMPLE_RATE_HZ
from lupin_runtime.voice.speech import SpeechUnavailable

MISSING_ARECORD = "the microphone needs arecord, which is not installed; type: sudo apt install alsa-utils, or use --text"
_END_TIMEOUT_S = 2.0


@contextlib.contextmanager
def open_microphone() -> Iterator[Iterator[bytes]]:
    """Yield an iterator of frames, which ends when arecord does. Raises SpeechUnavailable if it is missing or fails."""
    program = shutil.which("arecord")
    if program is None:
        raise SpeechUnavailable(MISSING_ARECORD)
    command = [program, "-q", "-t", "raw", "-f", "S16_LE", "-r", str(SAMPLE_RATE_HZ), "-c", "1"]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    try:
        yield _frames(process.stdout, process)
    finally:
        process.terminate()
        try:
            process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()
        process.stderr.close()


def _frames(stream: IO[bytes], process: subprocess.Popen[bytes]) -> Iterator[bytes]:
    while len(frame := stream.read(FRAME_BYTES)) == FRAME_BYTES:
        yield frame
    if process.wait():
        assert process.stderr is not None
        reason = process.stderr.read().decode(errors="replace").strip().splitlines()[-1:]
        raise SpeechUnavailable(f"arecord failed: {''.join(reason) or process.returncode}; see: arecord -l, or use --text")
