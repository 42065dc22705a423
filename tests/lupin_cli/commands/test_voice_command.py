"""`lupin voice` in a dry run, and what it says when something is missing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import wave
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.commands import voice
from lupin_cli.exit_codes import FAILURE, SUCCESS, UNREACHABLE, USAGE_ERROR
from lupin_cli.run import voice_session
from lupin_cli.run.voice_session import Options, run_session
from lupin_cli.terminal import echo
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.speech import SpeechUnavailable


@pytest.fixture
def home(tmp_path: Path) -> dict[str, str]:
    """An environment with a library of the arm and a location, without a run and without the recognizer."""
    library = {"version": 1, "poses": {"high_look": {"arm": [0, 0, 0, 0]}}, "sequences": {}}
    state = tmp_path / "state" / "lupin" / "console"
    for path, content in (
        (tmp_path / "config" / "lupin" / "arm_library.json", library),
        (state / "locations.json", {"sink": {"x": 1.0, "y": 2.0, "yaw": 0.0}}),
        (tmp_path / "missing" / "onnxruntime.py", None),
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("raise ImportError" if content is None else json.dumps(content))
    return {
        **os.environ,
        "XDG_CONFIG_HOME": str(tmp_path / "config"),
        "XDG_STATE_HOME": str(tmp_path / "state"),
        "PYTHONPATH": str(tmp_path / "missing"),
    }


def lupin(home: dict[str, str], *words: str, typed: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lupin_cli.app", "voice", *words]
    return subprocess.run(command, input=typed, capture_output=True, text=True, timeout=60, check=False, env=home)


def test_dry_run_shows_the_call_of_one_sentence(home: dict[str, str]) -> None:
    done = lupin(home, "--dry-run", "--text", "go to the sink")
    assert (done.returncode, done.stdout) == (SUCCESS, 'would call nav_goto_named {"name": "sink"}\n')


def test_lines_are_taken_in_their_order(home: dict[str, str]) -> None:
    done = lupin(home, "--dry-run", "--text", "--json", typed="lights blue\n\narm pose high look\nstop\nopen the door\n")
    replies = [json.loads(line) for line in done.stdout.splitlines()]
    assert [reply["call"] and reply["call"]["tool"] for reply in replies] == [
        "set_light",
        "arm_goto_pose",
        "engage_estop",
        None,
    ]
    assert replies[3]["done"] is False and replies[3]["nearest"] and done.returncode == FAILURE


def test_dutch_sentence_is_understood(home: dict[str, str]) -> None:
    done = lupin(home, "--dry-run", "--language", "nl", "--text", "ga twee meter vooruit")
    assert done.stdout == 'would call nav_forward {"forward_m": 2.0}\n'


def test_missing_packages_say_what_to_install(home: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "silence.wav"
    with wave.open(str(path), "wb") as written:
        written.setparams((1, 2, 16_000, 0, "NONE", ""))
        written.writeframes(b"\0" * 3200)
    done = lupin(home, "--dry-run", "--wav", str(path))
    assert done.returncode == USAGE_ERROR and "pip install 'lupin[voice]'" in done.stderr


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (["--text", "stop"], UNREACHABLE, "lupin up"),
        (["--console", "127.0.0.1:1", "stop"], UNREACHABLE, "no voice service at http://127.0.0.1:1"),
        (["--console", "robot.invalid", "stop"], UNREACHABLE, "the name robot.invalid is not known here"),
        (["--console", "no/host", "stop"], USAGE_ERROR, "is not HOST or HOST:PORT of a console"),
        (["--code", "K7Q2-MXPA", "stop"], USAGE_ERROR, "name it with --console"),
        (["--console", "localhost", "--forget"], USAGE_ERROR, "only the console of another computer is paired"),
        (["--console", "robot.invalid", "--code", "-", "stop"], USAGE_ERROR, "standard input has no code"),
        (["--dry-run", "--wav", "/missing.wav"], USAGE_ERROR, "cannot read /missing.wav: No such file or directory"),
        (["--dry-run", "--wav", "/dev/null", "stop"], USAGE_ERROR, "either a sound or a sentence"),
        (["--dry-run", "--language", "xx", "stop"], USAGE_ERROR, "'xx' is not one of en, nl"),
        (["--dry-run", "--language", "nl"], USAGE_ERROR, "English only"),
    ],
)
def test_error_says_what_to_do(home: dict[str, str], words: list[str], status: int, message: str) -> None:
    done = lupin(home, *words)
    assert (done.returncode, done.stdout) == (status, "") and message in " ".join(done.stderr.split())


def test_pairing_is_forgotten(home: dict[str, str]) -> None:
    path = Path(home["XDG_STATE_HOME"]) / "lupin" / "console" / "paired" / "robot.local_8090.json"
    path.parent.mkdir(parents=True)
    path.write_text("{}")
    words = ("--console", "robot.local", "--forget")
    assert lupin(home, *words, "--dry-run").stdout == f"would delete {path}\n" and path.exists()
    done = lupin(home, *words)
    assert (done.returncode, path.exists()) == (SUCCESS, False) and "lupin console revoke NAME" in done.stdout
    done = lupin(home, *words)
    assert (done.returncode, done.stdout) == (SUCCESS, "nothing to forget: robot.local is not known\n")


def test_code_is_the_first_line_of_standard_input() -> None:
    source, target = os.pipe()
    os.write(target, b" K7Q2-MXPA \nstop\n")
    os.close(target)
    assert voice._read_line(source) == "K7Q2-MXPA" and os.read(source, 100) == b"stop\n"
    assert voice._read_line(source) == ""
    os.close(source)


class Recognizer:
    """Hears the first of its texts in each sound."""

    texts: list[str]

    def __init__(self, names: Names) -> None:
        self.names = names

    def may_be_halt(self, word: bytes) -> bool:
        return not word

    def transcribe(self, sound: bytes) -> str:
        assert len(sound) > 16_000
        return self.texts.pop(0)


def options(**changes: Any) -> Options:
    chosen: dict[str, Any] = {
        "sentence": None, "is_typed": False, "wav": None, "language": ENGLISH, "speaks": False, "as_json": False,
        "console": None, **changes,
    }  # fmt: skip
    return Options(**chosen)


def test_sound_is_cut_into_sentences(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    spoken, pause = b"\0\x10" * 8_000, b"\0" * 32_000
    with wave.open(str(tmp_path / "speech.wav"), "wb") as written:
        written.setparams((1, 2, 16_000, 0, "NONE", ""))
        written.writeframes(spoken + pause + spoken + pause + spoken)
    monkeypatch.setattr(Recognizer, "texts", ["Lights blue.", "", "Thank you."], raising=False)
    monkeypatch.setattr(voice_session, "CommandRecognizer", Recognizer)
    assert not run_session(options(wav=tmp_path / "speech.wav"))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == '\'Lights blue.\': would call set_light {"color": "blue"}'
    assert lines[1].startswith("'Thank you.': I did not understand that.") and len(lines) == 2


def test_microphone_is_heard_until_it_ends(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "sound").write_bytes(b"\0\x10" * 8_000 + b"\0" * 32_000)
    program = tmp_path / "arecord"
    more = f"while [ ! -e {tmp_path}/shown ]; do head -c 1600 /dev/zero; sleep 0.05; done"
    program.write_text(f"#!/bin/sh\ncat {tmp_path}/sound\n{more}\necho unplugged >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")

    class Stopped(Recognizer):
        def transcribe(self, sound: bytes) -> str:
            assert sound
            return "Stop."

        transcribe_window = transcribe

    def show(message: object, *, err: bool = False) -> None:
        echo(message, err=err)
        if not err:
            (tmp_path / "shown").touch()

    monkeypatch.setattr(voice_session, "CommandRecognizer", Stopped)
    monkeypatch.setattr(voice_session, "echo", show)
    with pytest.raises(SpeechUnavailable, match=r"the microphone is lost: unplugged; see .* arecord -l"):
        run_session(options())
    # By the spotter, or by the whole sentence if that was faster: never by both.
    assert capsys.readouterr().out == "'Stop.': would call engage_estop {}\n"


def test_voice_imports_no_speech_packages_before_they_are_used() -> None:
    program = (
        "import sys, lupin_cli.app, lupin_cli.run.voice_session\n"
        "heavy = ('numpy', 'scipy', 'onnxruntime', 'moonshine_voice', 'aiohttp')\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "[]\n"
