"""Sounds of WAV files as 16 kHz mono PCM-16, which the recognizer takes."""

from __future__ import annotations

import io
import math
import wave
from pathlib import Path

from lupin_runtime.bounded_file import read_bounded
from lupin_runtime.voice.endpointer import SAMPLE_BYTES, SAMPLE_RATE_HZ

MAX_WAV_BYTES = 200_000_000
_RATES_HZ = range(8_000, 192_001)
_EXPECTED = "expected a WAV file with 16-bit PCM of 8 to 192 kHz"


class BadSound(ValueError):
    """A file that is no sound of a kind that can be read; the text says what was expected."""


def read_wav_file(path: Path) -> bytes:
    """Return the sound of a WAV file. Raises BadSound and OSError."""
    return read_wav(read_bounded(path, MAX_WAV_BYTES))


def read_wav(contents: bytes) -> bytes:
    """Return the sound of a WAV file's contents, with its channels mixed. Raises BadSound."""
    try:
        with wave.open(io.BytesIO(contents)) as opened:
            channels, width, rate_hz = opened.getnchannels(), opened.getsampwidth(), opened.getframerate()
            data = opened.readframes(len(contents))  # a header that was written to a pipe has no length
    except (wave.Error, EOFError, ValueError) as error:
        raise BadSound(f"{_EXPECTED}: {error or 'it ends too early'}") from error
    if width != SAMPLE_BYTES or rate_hz not in _RATES_HZ or not channels:
        raise BadSound(f"{_EXPECTED}, found {8 * width}-bit samples at {rate_hz / 1000:g} kHz in {channels} channels")
    return _convert(data, channels, rate_hz)


def _convert(data: bytes, channels: int, rate_hz: int) -> bytes:
    import numpy

    samples = numpy.frombuffer(data[: len(data) // (SAMPLE_BYTES * channels) * SAMPLE_BYTES * channels], "<i2")
    mono = samples.reshape(-1, channels).mean(axis=1)
    if rate_hz != SAMPLE_RATE_HZ and len(mono):
        from scipy.signal import resample_poly

        common = math.gcd(rate_hz, SAMPLE_RATE_HZ)
        mono = resample_poly(mono, SAMPLE_RATE_HZ // common, rate_hz // common)
    return bytes(numpy.clip(numpy.rint(mono), -32768, 32767).astype("<i2").tobytes())
