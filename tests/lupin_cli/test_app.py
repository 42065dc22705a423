"""The command line: every listed command exists, unknown ones are corrected, and help imports nothing heavy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from lupin_cli.app import COMMANDS, main
from lupin_cli.connection import Unreachable


def lupin(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "lupin_cli.app", *arguments], capture_output=True, text=True, timeout=60, check=False
    )


def test_help_lists_every_command() -> None:
    done = lupin("--help")
    assert done.returncode == 0
    for verb in COMMANDS:
        assert f"\n  {verb} " in done.stdout


@pytest.mark.parametrize("verb", COMMANDS)
def test_every_command_has_help(verb: str) -> None:
    done = lupin(verb, "--help")
    assert done.returncode == 0, done.stderr
    assert "Usage:" in done.stdout


def test_unknown_command_names_the_nearest() -> None:
    done = lupin("dwn")
    assert done.returncode == 2
    assert "lupin down" in done.stderr


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from lupin_cli.app import app\n"
        "try:\n    app(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = ('rich.console', 'numpy', 'rclpy', 'psutil', 'paramiko', 'mujoco', 'cv2', 'cryptography')\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout.strip().splitlines()[-1] == "[]", done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("--target", "moon"),
        ("--discovery-goal", "some"),
        ("--map", "/no/such.yaml"),
        ("--speed", "0"),
        ("--seed", "-1"),
        ("--world", "atlantis"),
    ],
)
@pytest.mark.parametrize("detach", [(), ("--detach",)], ids=["foreground", "detached"])
def test_bad_options_of_up_are_usage_errors(arguments: tuple[str, ...], detach: tuple[str, ...]) -> None:
    done = lupin("up", *arguments, *detach)
    assert done.returncode == 2
    assert arguments[0] in done.stderr and "has started" not in done.stdout + done.stderr


def test_commands_without_a_live_run_name_lupin_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for verb in ("status", "down", "logs"):
        done = lupin(verb)
        assert done.returncode == 3
        assert "lupin up" in done.stderr


def test_full_disk_is_not_reported_as_a_defect() -> None:
    with open("/dev/full", "wb") as full:  # noqa: PTH123 - a device
        command = [sys.executable, "-m", "lupin_cli.app", "--help"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    assert done.returncode == 70
    assert "No space left on device" in done.stderr and "defect" not in done.stderr


def test_closed_pipe_ends_output_without_a_traceback() -> None:
    command = f"{sys.executable} -m lupin_cli.app --help | true"
    done = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (Unreachable("robot: nothing answers", "timeout", "ping robot"), 3, "robot: nothing answers\n  next: ping robot\n"),
        (RuntimeError("odd"), 70, "lupin: RuntimeError: odd\nlupin: this is a defect of Lupin\n"),
    ],
)
def test_unhandled_error_is_reported_without_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: Exception, code: int, text: str
) -> None:
    def fail() -> None:
        raise error

    monkeypatch.setattr("lupin_cli.app.app", fail)
    monkeypatch.setattr(sys, "argv", ["lupin", "doctor"])
    with pytest.raises(SystemExit) as exited:
        main()
    assert exited.value.code == code and text in capsys.readouterr().err


@pytest.mark.parametrize(
    ("verb", "function"),
    [
        ("doctor", "lupin_cli.doctor.session.examine_all"),
        ("bundle", "lupin_cli.bundle.collect.examine_all"),
        ("home", "lupin_cli.app.app"),
    ],
)
def test_interrupt_in_the_release_of_a_lock_counts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, verb: str, function: str
) -> None:
    def wait_for_threads(*_: object, **_options: object) -> None:
        try:
            raise KeyboardInterrupt
        finally:
            raise RuntimeError("release unlocked lock")  # as threading's Condition does, whose wait was interrupted

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(function, wait_for_threads)
    monkeypatch.setattr(sys, "argv", ["lupin", verb, "--local"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130
    assert list(tmp_path.iterdir()) == []
