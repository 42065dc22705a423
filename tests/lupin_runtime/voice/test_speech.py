"""Speaking and the microphone need programs, and say what to install; sounds of WAV files are converted."""

from __future__ import annotations

import array
import io
import os
import wave
from pathlib import Path

import pytest

from lupin_runtime.voice import microphone
from lupin_runtime.voice.endpointer import FRAME_BYTES, SAMPLE_RATE_HZ, rms
from lupin_runtime.voice.microphone import MISSING_ARECORD, open_microphone
from lupin_runtime.voice.sounds import BadSound, read_wav, read_wav_file
from lupin_runtime.voice.speech import MISSING_ESPEAK, Speaker, SpeechUnavailable


def wav(samples: list[int], rate_hz: int = SAMPLE_RATE_HZ, channels: int = 1, width: int = 2) -> bytes:
    target = io.BytesIO()
    with wave.open(target, "wb") as written:
        written.setnchannels(channels)
        written.setsampwidth(width)
        written.setframerate(rate_hz)
        written.writeframes(array.array("h", samples).tobytes())
    return target.getvalue()


def install(folder: Path, name: str, script: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a shell script before all programs."""
    program = folder / name
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


# -- espeak-ng ---------------------------------------------------------------------------------------------------------
def test_missing_espeak_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SpeechUnavailable) as raised:
        Speaker()
    assert str(raised.value) == MISSING_ESPEAK


def test_text_is_given_on_standard_input(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # A text that begins with a dash is no option, and one with markup of espeak's is spoken as it is.
    install(tmp_path, "espeak-ng", f'echo "$@" > {tmp_path}/options; cat > {tmp_path}/text', monkeypatch)
    Speaker("en-us", 150).say("--version <b>[[x]]")
    assert (tmp_path / "options").read_text() == "-v en-us -s 150 --stdin\n"
    assert (tmp_path / "text").read_text() == "--version  b   x  "


def test_synthesized_sound_is_converted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "sound.wav").write_bytes(wav([1000] * 22050, 22050))
    install(tmp_path, "espeak-ng", f"cat > /dev/null; cat {tmp_path}/sound.wav", monkeypatch)
    assert len(Speaker().synthesize("hello")) == 2 * SAMPLE_RATE_HZ


def test_failure_of_espeak_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    install(tmp_path, "espeak-ng", "cat > /dev/null; echo no sound device >&2; exit 1", monkeypatch)
    with pytest.raises(SpeechUnavailable, match="no sound device"):
        Speaker().say("hello")


# -- WAV files ---------------------------------------------------------------------------------------------------------
def test_sound_of_the_right_kind_is_unchanged() -> None:
    samples = [0, 1, -1, 32767, -32768]
    assert read_wav(wav(samples)) == array.array("h", samples).tobytes()


def test_channels_are_mixed() -> None:
    assert read_wav(wav([100, 300, -100, -300], channels=2)) == array.array("h", [200, -200]).tobytes()


@pytest.mark.parametrize("rate_hz", [8_000, 22_050, 44_100, 48_000])
def test_other_rates_are_converted(rate_hz: int) -> None:
    sound = read_wav(wav([1000] * rate_hz, rate_hz))
    assert len(sound) == 2 * SAMPLE_RATE_HZ and abs(rms(sound) - 1000 / 32768) < 0.001


def test_header_that_was_written_to_a_pipe_is_read(tmp_path: Path) -> None:
    contents = bytearray(wav([5] * 100))
    contents[40:44] = (0x7FFFFFFF).to_bytes(4, "little")
    path = tmp_path / "piped.wav"
    path.write_bytes(contents)
    assert read_wav_file(path) == array.array("h", [5] * 100).tobytes()


@pytest.mark.parametrize(
    "contents", [b"", b"RIFF", b"RIFF\4\0\0\0WAVE", b"not a sound", wav([0] * 10)[:30], wav([0] * 10, width=1), wav([0], 100)]
)
def test_other_files_are_refused(contents: bytes) -> None:
    with pytest.raises(BadSound, match="expected a WAV file with 16-bit PCM"):
        read_wav(contents)


def test_empty_sound_has_no_samples() -> None:
    assert read_wav(wav([])) == b""


# -- microphone --------------------------------------------------------------------------------------------------------
def test_end_of_arecord_is_a_lost_microphone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    install(tmp_path, "arecord", f"head -c {3 * FRAME_BYTES + 10} /dev/zero", monkeypatch)
    with open_microphone() as frames:
        assert [len(next(frames)) for _ in range(3)] == [FRAME_BYTES] * 3
        with pytest.raises(SpeechUnavailable, match=r"the microphone is lost: arecord ended with 0; see .* arecord -l"):
            next(frames)


@pytest.mark.parametrize("script", ["exec sleep 60", "head -c 1600 /dev/zero; exec sleep 60"], ids=["never", "no-more"])
def test_microphone_that_sends_nothing_is_lost(script: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(microphone, "START_TIMEOUT_S", 0.3)
    monkeypatch.setattr(microphone, "MAX_GAP_S", 0.3)
    install(tmp_path, "arecord", f"trap '' TERM; {script}", monkeypatch)
    with open_microphone() as frames, pytest.raises(SpeechUnavailable, match=r"it has sent nothing for 0\.3 s"):
        list(frames)


def test_arecord_that_only_closes_its_output_is_ended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(microphone, "_END_TIMEOUT_S", 0.2)
    install(tmp_path, "arecord", "exec >&-; exec sleep 60", monkeypatch)
    with open_microphone() as frames, pytest.raises(SpeechUnavailable, match="the microphone is lost: arecord ended with -9"):
        next(frames)


def test_arecord_ends_with_the_block(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    install(tmp_path, "arecord", f"echo $$ > {tmp_path}/pid; exec cat /dev/zero", monkeypatch)
    with open_microphone() as frames:
        assert len(next(frames)) == FRAME_BYTES
    assert not Path(f"/proc/{(tmp_path / 'pid').read_text().strip()}").exists()


def test_missing_or_failing_arecord_says_what_to_do(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    install(tmp_path, "arecord", "echo audio open error >&2; exit 1", monkeypatch)
    with open_microphone() as frames, pytest.raises(SpeechUnavailable, match=r"audio open error; see .* arecord -l"):
        next(frames)
    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))
    with pytest.raises(SpeechUnavailable) as raised, open_microphone():
        pass
    assert str(raised.value) == MISSING_ARECORD
