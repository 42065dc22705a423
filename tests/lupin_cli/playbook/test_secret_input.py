"""Secrets of playbooks: typed, from a file or from standard input, and seen nowhere afterwards."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_cli.playbook import load
from lupin_cli.playbook.journal import Mask
from lupin_cli.playbook.secret_input import MAX_BYTES, SecretError, read_secrets

SECRET = """it's "hunter2" $(and) more"""
PLAYBOOK = """
vars:
  root: {type: text}
  key: {type: secret, help: The key of the network.}
steps:
- name: look at the processes
  on: laptop
  probe: {run: "ps -eo args > {{ root }}/probe"}
- name: write
  on: laptop
  file: {path: "{{ root }}/config", content: "x={{ key }}\\ny\\n", mode: "0600"}
- name: print
  on: laptop
  as: printed
  command:
    run: |
      cat {{ root }}/config; ps -eo args > {{ root }}/command; touch {{ root }}/done
    creates: "{{ root }}/done"
- name: show
  on: laptop
  as: shown
  probe: {run: "cat {{ root }}/config 2>/dev/null; exit 0"}
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "LUPIN_CONFIG"))}
    return {**kept, "HOME": str(tmp_path)}


@pytest.fixture
def playbook(write_playbook: Callable[..., Path]) -> Path:
    return write_playbook(PLAYBOOK)


def play(environment: dict[str, str], playbook: Path, *words: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lupin_cli.app", "play", str(playbook), "-v", f"root={environment['HOME']}", *words]
    return subprocess.run(command, env=environment, input=stdin, capture_output=True, text=True, timeout=60, check=False)


def assert_hidden(text: str) -> None:
    for form in ("hunter2", json.dumps(SECRET)[1:-1]):
        assert form not in text, text


def test_secret_is_used_and_shown_nowhere(environment: dict[str, str], playbook: Path, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text(f"{SECRET}\n")
    dry = play(environment, playbook, "--hidden", f"key={tmp_path}/secret", "--dry-run", "--diff", "--json")
    diff = play(environment, playbook, "--hidden", "key=-", "--dry-run", "--diff", stdin=f"{SECRET}\n")
    assert (dry.returncode, diff.returncode) == (0, 0), dry.stderr + diff.stderr
    assert "+x=***" in diff.stdout
    assert not (tmp_path / "config").exists()
    done = play(environment, playbook, "--hidden", "key=~/secret", "--json")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "config").read_text() == f"x={SECRET}\ny\n"
    result = json.loads(done.stdout)
    assert result["steps"][3]["result"]["stdout"] == "x=***\ny"
    (journal,) = (tmp_path / ".local" / "state" / "lupin" / "journal").iterdir()
    assert "x=***" in journal.read_text()
    assert "--hidden key" in journal.read_text(), "the journal says how to start the run again"
    for text in (dry.stdout, dry.stderr, diff.stdout, diff.stderr, done.stdout, done.stderr, journal.read_text()):
        assert_hidden(text)
    for name in ("probe", "command"):
        assert "lupin_cli.app" in (tmp_path / name).read_text()
        assert_hidden((tmp_path / name).read_text())


def test_secret_is_asked_for_without_echo(environment: dict[str, str], playbook: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "lupin_cli.app", "play", str(playbook), "-v", f"root={tmp_path}", "--dry-run"]
    pid, terminal = pty.fork()
    if pid == 0:
        os.execve(sys.executable, command, environment)
    seen = b""
    while b"network): " not in seen:
        seen += os.read(terminal, 4096)
    os.write(terminal, b"hunter2-typed\n")
    try:
        while chunk := os.read(terminal, 4096):
            seen += chunk
    except OSError:  # the terminal's other end was closed
        pass
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0, seen
    assert b"key (The key of the network): " in seen and b"would change" in seen
    assert b"hunter2" not in seen


def test_secret_in_an_argument_is_warned_about(environment: dict[str, str], playbook: Path) -> None:
    ran = play(environment, playbook, "-v", "key=hunter2-and-more", "--dry-run")
    assert ran.returncode == 0 and "use: --hidden key" in ran.stderr
    assert_hidden(ran.stdout + ran.stderr)


@pytest.mark.parametrize(
    ("words", "stdin", "expected"),
    [
        ((), "", "'key' must be given (The key of the network.): --hidden key"),
        (("--hidden", "key"), "", "nobody can be asked for 'key' without a terminal: give --hidden key=FILE, or key=-"),
        (("--hidden", "key=/nowhere"), "", "'key' cannot be read from /nowhere: No such file or directory"),
        (("--hidden", "key=~nobody-here/x"), "", "'key' cannot be read from ~nobody-here/x"),
        (("--hidden", "key=/dev/zero"), "", f"/dev/zero has more than {MAX_BYTES} bytes"),
        (("--hidden", "key="), "", "--hidden key= names no file"),
        (("--hidden", "key=-"), "", "standard input is empty"),
        (("--hidden", "key=-"), "a\0hunter2", "standard input contains a NUL"),
        (("--hidden", "kye=-"), "hunter2", "has no variable 'kye'; did you mean 'key'"),
        (("--hidden", "key=-", "-v", "key=hunter2"), "hunter2", "'key' is given twice"),
        (("--hidden", "key=-", "--hidden", "root=-"), "hunter2", "standard input has one secret only"),
    ],
)
def test_unusable_secret_is_a_usage_error(
    environment: dict[str, str], playbook: Path, words: tuple[str, ...], stdin: str, expected: str
) -> None:
    ran = play(environment, playbook, *words, stdin=stdin)
    assert ran.returncode == 2 and expected in " ".join(ran.stderr.split()), ran.stderr
    assert_hidden(ran.stdout + ran.stderr)


def test_bytes_that_are_no_text_are_not_shown(write_playbook: Callable[..., Path], tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(b"hunter2\xff")
    playbook = load(write_playbook(PLAYBOOK))
    with pytest.raises(SecretError, match="secret is not UTF-8 text") as caught:
        read_secrets(playbook, [f"key={tmp_path}/secret"], {}, ask_missing=False)
    assert "hunter2" not in repr(caught.value) and caught.value.__cause__ is None


def test_secret_of_an_included_playbook_is_masked(write_playbook: Callable[..., Path], tmp_path: Path) -> None:
    from lupin_cli.connection.local import LocalTarget
    from lupin_cli.playbook import play as play_playbook

    write_playbook(
        "vars: {psk: {type: secret}}\nsteps:\n- name: print\n  on: laptop\n"
        f"  command: {{run: 'echo got {{{{ psk }}}}; touch {tmp_path}/done', creates: {tmp_path}/done}}\n",
        "inner",
    )
    outer = write_playbook("vars: {word: {type: text}}\nsteps:\n- include: inner\n  vars: {psk: '{{ word }}'}\n", "outer")
    result = play_playbook(load(outer), {"laptop": LocalTarget()}, {"word": "hunter2-text"}, journal=tmp_path / "journal")
    assert result.state == "done", result.message
    text = next((tmp_path / "journal").iterdir()).read_text()
    assert "got ***" in text and "hunter2" not in text


@pytest.mark.parametrize(
    "shown",
    [
        lambda secret: secret,
        lambda secret: repr(secret),
        lambda secret: json.dumps({"error": secret}),
        lambda secret: "".join(f"+{line}\n" for line in secret.splitlines()),
    ],
)
@pytest.mark.parametrize("secret", [SECRET, "one line\nand hunter2", "hunter2\\n", "hunter2 ü"])
def test_mask_finds_a_secret_in_quotes_and_lines(secret: str, shown: Callable[[str], str]) -> None:
    assert "hunter2" not in Mask((secret,))(f"before {shown(secret)} after")
