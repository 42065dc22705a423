"""The command line itself: what is listed exists, what does not exist is corrected, nothing heavy is imported for help."""

from __future__ import annotations

import subprocess
import sys

import pytest

from lupin_cli.app import COMMANDS


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


def test_a_typing_error_is_answered_with_the_nearest_command() -> None:
    done = lupin("dwn")
    assert done.returncode == 2
    assert "lupin down" in done.stderr


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from lupin_cli.app import app\n"
        "try:\n    app(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = ('rich.console', 'numpy', 'rclpy', 'psutil', 'paramiko', 'mujoco', 'cv2')\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout.strip().splitlines()[-1] == "[]", done.stderr


@pytest.mark.parametrize(
    "arguments",
    [("up", "--target", "moon"), ("up", "--discovery-goal", "some"), ("up", "--map", "/no/such.yaml"), ("up", "--speed", "0")],
)
def test_bad_options_are_usage_errors_before_anything_starts(arguments: tuple[str, ...]) -> None:
    done = lupin(*arguments)
    assert done.returncode == 2
    assert arguments[1] in done.stderr


def test_verbs_that_need_a_run_say_how_to_start_one(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for verb in ("status", "down", "logs"):
        done = lupin(verb)
        assert done.returncode == 3
        assert "lupin up" in done.stderr
