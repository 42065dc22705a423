"""An error of a thread or a finalizer fails the session, and no test in particular."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

OK, FAILED = pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED

FILTERS = """
[tool.pytest.ini_options]
filterwarnings = ["error:::(lupin_cli|tests)\\\\b", "error::ResourceWarning"]
"""


def run_pytest(folder: Path, text: str, *options: str) -> tuple[int, str]:
    (folder / "pyproject.toml").write_text(FILTERS)
    (folder / "test_it.py").write_text(text)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.support.late_errors", *options]
    done = subprocess.run(
        [*command, "--rootdir", str(folder), "-c", str(folder / "pyproject.toml"), str(folder / "test_it.py")],
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    return done.returncode, done.stdout


@pytest.mark.parametrize("options", [(), ("-n", "1")])
def test_thread_error_fails_the_session_and_no_test(tmp_path: Path, options: tuple[str, ...]) -> None:
    text = "import threading\ndef test_it():\n    t = threading.Thread(target=lambda: 1 / 0); t.start(); t.join()\n"
    status, output = run_pytest(tmp_path, text, *options)
    assert status == FAILED and "1 passed" in output
    assert "of no test in particular: 1" in output and "ZeroDivisionError" in output


def test_unclosed_file_is_an_error_of_the_session(tmp_path: Path) -> None:
    status, output = run_pytest(tmp_path, "def test_it():\n    open(__file__)\ndef test_next(): pass\n")
    assert status == FAILED and "2 passed" in output and "ResourceWarning: unclosed file" in output


def test_failed_test_fails_the_session_by_itself(tmp_path: Path) -> None:
    status, output = run_pytest(tmp_path, "def test_it():\n    open(__file__)\n    assert False\n")
    assert status == FAILED and "1 failed" in output


def test_warning_of_another_package_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text("import warnings\ndef pytest_runtest_setup():\n    warnings.warn('theirs')\n")
    status, output = run_pytest(tmp_path, "def test_it(): pass\n")
    assert status == OK and "theirs" in output


def test_warning_of_lupin_is_an_error_of_its_test(tmp_path: Path) -> None:
    text = "def test_it():\n    exec('import warnings; warnings.warn(\"ours\")', {'__name__': 'lupin_cli.doctor'})\n"
    status, output = run_pytest(tmp_path, text)
    assert status == FAILED and "1 failed" in output and "ours" in output
