"""Text from elsewhere reaches a terminal without control characters."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import lupin_cli
from lupin_cli.terminal import echo, minutes, printable, progress_text, status_line, wrapped


@given(st.text())
def test_printable_keeps_text_and_replaces_control_characters(text: str) -> None:
    shown = printable(text)
    assert all(character in "\n\t" or not (character < " " or "\x7f" <= character <= "\x9f") for character in shown)
    assert printable(shown) == shown
    if text.isprintable():
        assert shown == text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b]0;title\x07", "�]0;title�"),
        ("\x9b2J", "�2J"),
        ("a\r\nb\tc\n", "a\nb\tc\n"),
        ("1 %\r2 %", "1 %�2 %"),
        ("del\x7f", "del�"),
        ("Grüße, 植物", "Grüße, 植物"),
    ],
)
def test_printable_replaces_what_a_terminal_obeys(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_echo_prints_no_escape_sequences(capsys: pytest.CaptureFixture[str]) -> None:
    echo("\x1b[2Jout")
    echo("\x1b[2Jerr", err=True)
    echo("same line", nl=False)
    captured = capsys.readouterr()
    assert captured.out == "�[2Jout\nsame line" and captured.err == "�[2Jerr\n"


def test_json_escapes_control_characters_itself() -> None:
    assert "\x1b" not in json.dumps("\x1b[2J")


@pytest.mark.parametrize(("repaints", "end"), [(True, "\r\x1b[K"), (False, "\n")], ids=["terminal", "dumb"])
def test_status_line_is_erased_after_the_block(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], repaints: bool, end: str
) -> None:
    monkeypatch.setattr("lupin_cli.terminal.can_repaint", lambda _: repaints)
    with status_line("asking greenhouse ...", shown=True):
        pass
    with status_line("not shown", shown=False):
        pass
    assert capsys.readouterr().err == f"asking greenhouse ...{end}"


def test_only_terminal_prints_through_typer() -> None:
    package = Path(lupin_cli.__file__).parent
    callers = {path.name for path in package.rglob("*.py") if "typer.echo(" in path.read_text()}
    assert callers == {"terminal.py"}


@given(st.text(alphabet="ab-/ \n", max_size=300), st.sampled_from([20, 80, 100]))
def test_wrapped_text_keeps_its_words_whole(text: str, columns: int) -> None:
    broken = wrapped(text, columns)
    assert broken.split() == text.split()
    for line in broken.split("\n"):
        assert len(line) <= columns or len(line.split()) == 1


def test_echo_breaks_lines_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", "30")
    text = "lupin play: the robot has no release of this id, see the journal"
    echo(text)
    assert capsys.readouterr().out == f"{text}\n"
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    echo(text)
    assert capsys.readouterr().out.splitlines() == [
        "lupin play: the robot has no",
        "  release of this id, see the",
        "  journal",
    ]
    echo(text, wrap=False)
    assert capsys.readouterr().out == f"{text}\n"


REPORTING = (  # as `lupin up`: it prints until it is interrupted, then writes a report and prints again
    "import pathlib, signal, sys, time\n"
    "from lupin_cli.safe_console import SafeConsole\n"
    "from lupin_cli.terminal import echo, output_may_vanish\n"
    "ended = []\n"
    "with output_may_vanish():\n"
    "    signal.signal(signal.SIGHUP, lambda *_: ended.append(1)) if sys.argv[2:] else None\n"
    "    console = SafeConsole()\n"
    "    deadline = time.monotonic() + 50\n"
    "    for number in range(100_000):\n"
    "        console.print(f'line {number}')\n"
    "        echo('error', err=True)\n"
    "        if pathlib.Path(sys.argv[1] + '.closed').exists() and number > 100 or time.monotonic() > deadline:\n"
    "            break\n"
    "        time.sleep(0.01)\n"
    "    with console.status('building the report'):\n"
    "        pathlib.Path(sys.argv[1]).write_text(f'report {len(ended)}')\n"
    "    console.print('done')\n"
)


@pytest.mark.parametrize("handler", [(), ("own",)])
def test_work_is_finished_after_its_terminal_was_closed(tmp_path: Path, handler: tuple[str, ...]) -> None:
    report = tmp_path / "report"
    pid, master = pty.fork()
    if pid == 0:  # a session of its own whose terminal is the other end
        os.execv(sys.executable, [sys.executable, "-c", REPORTING, str(report), *handler])
    assert b"line" in os.read(master, 1000)
    os.close(master)  # the kernel hangs up: SIGHUP, and EIO for everything that is printed
    Path(f"{report}.closed").touch()
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == 0
    assert report.read_text() == f"report {len(handler)}"


def test_work_is_finished_after_the_reader_of_its_pipe_ended(tmp_path: Path) -> None:
    report = tmp_path / "report"
    Path(f"{report}.closed").touch()
    command = f'exec {sys.executable} -c "$PROGRAM" {report}'
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", f"({command}) 2>&1 | head -1"],
        env={**os.environ, "PROGRAM": REPORTING},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "line 0\n")
    assert report.read_text() == "report 0"


@pytest.mark.parametrize(("seconds", "text"), [(0.0, "0:00"), (61.9, "1:01"), (3599.0, "59:59"), (3600.0, "1:00:00")])
def test_duration_is_written_as_a_clock_shows_it(seconds: float, text: str) -> None:
    assert minutes(seconds) == text


WORKING = (  # it works until a line of progress was read, or for a minute
    "import pathlib, sys, time\n"
    "from lupin_cli.terminal import work_progress\n"
    "deadline = time.monotonic() + 60\n"
    "with work_progress() as show:\n"
    "    show('reading ' + '\\x1b]0;x\\x07' + 'a' * 200 if sys.argv[2:] else 'reading', 0.25)\n"
    "    while not pathlib.Path(sys.argv[1]).exists() and time.monotonic() < deadline:\n"
    "        time.sleep(0.05)\n"
    "print('result')\n"
)


def work_on_a_terminal(flag: Path, term: str, *arguments: str) -> bytes:
    """Run WORKING on a terminal of 80 columns; return what it printed, up to and after the first line of progress."""
    pid, master = pty.fork()
    if pid == 0:
        os.environ.update(TERM=term, COLUMNS="80")
        os.execv(sys.executable, [sys.executable, "-c", WORKING, str(flag), *arguments])
    printed = b""
    while b"reading" not in printed:
        printed += os.read(master, 1000)
    flag.touch()
    with contextlib.suppress(OSError):  # EIO: the other end is closed
        while data := os.read(master, 1000):
            printed += data
    os.close(master)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    return printed


def test_progress_is_one_line_that_gives_way_to_the_result(tmp_path: Path) -> None:
    printed = work_on_a_terminal(tmp_path / "flag", "xterm")
    bar = f"{'━' * 5}{'─' * 15}  25 %".encode()
    assert b"reading  " + bar in printed and printed.endswith(b"\r\x1b[Kresult\r\n")
    assert b"\n" not in printed.removesuffix(b"\n")


def test_progress_fits_into_the_line_and_obeys_no_name(tmp_path: Path) -> None:
    printed = work_on_a_terminal(tmp_path / "flag", "xterm", "hostile").decode()
    assert "\x07" not in printed and all(len(line) <= 79 for line in printed.split("\r\x1b[K"))


def test_dumb_terminal_gets_lines_of_progress(tmp_path: Path) -> None:
    printed = work_on_a_terminal(tmp_path / "flag", "dumb")
    assert b"\x1b" not in printed and printed.splitlines()[0].startswith(b"reading  ")
    assert printed.splitlines()[-1] == b"result"


def test_short_work_shows_no_progress(tmp_path: Path) -> None:
    (tmp_path / "flag").touch()
    done = subprocess.run(
        [sys.executable, "-c", WORKING, str(tmp_path / "flag")], capture_output=True, text=True, timeout=60, check=True
    )
    assert (done.stdout, done.stderr) == ("result\n", "")


@pytest.mark.parametrize(("share", "text"), [(None, "x  1:05"), (-1.0, "  0 %"), (0.5, " 50 %"), (7.0, "100 %")])
def test_line_of_progress(share: float | None, text: str) -> None:
    assert text in progress_text("x", share, 65.0)
