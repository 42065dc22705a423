"""Completion at Tab, asked through the scripts that `lupin completion` prints, in a real bash."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from lupin_cli import completion
from lupin_cli.app import COMMANDS
from lupin_cli.commands.completion import SCRIPTS
from lupin_runtime.stack.runs import create_run
from lupin_sim.worlds.catalog import CATALOG

HEAVY = ("rich.console", "numpy", "rclpy", "psutil", "paramiko", "mujoco", "cv2", "cryptography", "jinja2", "aiohttp")


@pytest.fixture
def run_id(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The id of an ended run; robots are in an inventory, and `lupin` is a command on PATH."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("LUPIN_CONFIG", raising=False)
    inventory = tmp_path / "config" / "lupin" / "lupin.toml"
    inventory.parent.mkdir(parents=True)
    inventory.write_text('[robots.pot-1.addresses]\nwired = "10.42.0.1"\n[robots.pot-2.addresses]\nwired = "10.42.0.2"\n')
    program = tmp_path / "bin" / "lupin"
    program.parent.mkdir()
    program.write_text(f"#!{sys.executable}\nimport sys\nfrom lupin_cli.app import main\nsys.argv[0] = 'lupin'\nmain()\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    run, lock = create_run()
    os.close(lock)
    return run.id


def offered(*words: str) -> list[str]:
    """Return what bash offers for the last of the words after `lupin`."""
    typed = " ".join(shlex.quote(word) for word in ("lupin", *words))
    script = (
        f'eval "$(lupin completion bash)"; COMP_WORDS=({typed}); COMP_CWORD={len(words)}\n'
        '_lupin_completion lupin; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0 and done.stderr == "", done.stderr
    return done.stdout.split()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("",), set(COMMANDS)),
        (("ru",), {"run", "runs"}),
        (("doctor", "--robot", "pot"), {"pot-1", "pot-2"}),
        (("robots", "check", "pot-2"), {"pot-2"}),
        (("up", "--world", "w"), {"walled"}),
        (("play", "sync"), {"sync-clock"}),
        (("run", "sl"), {"slam"}),
        (("mission", "pa"), {"pause"}),
        (("logs", "--le"), {"--level"}),
        (("nothing", ""), set()),
    ],
)
@pytest.mark.usefixtures("run_id")
def test_bash_offers_what_fits_at_the_cursor(words: tuple[str, ...], expected: set[str]) -> None:
    assert set(offered(*words)) == expected


def test_bash_offers_runs_by_id_and_by_its_end(run_id: str) -> None:
    assert offered("report", "") == ["latest", run_id]
    assert offered("runs", "keep", run_id[:12]) == [run_id]
    assert offered("replay", run_id[-4:-1]) == [run_id[-4:]]
    assert offered("status", "--run", "l") == ["latest"]
    assert offered("down", "--run", "") == [], "it is not up"


@pytest.mark.parametrize("content", [None, "robots = 3", "[", "[robots.a.addresses]\nwired = 3", "\ud800"])
def test_unreadable_inventory_offers_no_robot(run_id: str, tmp_path: Path, content: str | None) -> None:
    path = tmp_path / "config" / "lupin" / "lupin.toml"
    path.unlink()
    if content is not None:
        path.write_bytes(content.encode("utf-8", "surrogatepass"))
    assert run_id and offered("doctor", "--robot", "") == []


def test_worlds_are_those_of_the_simulator() -> None:
    assert tuple(entry.name for entry in CATALOG) == completion.WORLDS


@pytest.mark.parametrize("words", ["lupin report ", "lupin doctor --robot ", "lupin play ", "lupin up --world ", "lupin run "])
def test_completion_imports_nothing_heavy(words: str) -> None:
    code = (
        "import os, sys; from lupin_cli.app import app\n"
        "try:\n    app(prog_name='lupin')\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)"
    )
    environment = {**os.environ, "_LUPIN_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=environment, check=False
    )
    assert done.stderr.strip() == "[]", done.stderr


@pytest.mark.parametrize("shell", SCRIPTS)
def test_script_is_valid_for_its_shell(shell: str) -> None:
    program = shutil.which(shell)
    if program is None:  # the words that a script passes are those of bash's script, which the tests above run
        assert "_LUPIN_COMPLETE=complete_bash" in SCRIPTS[shell] and "COMP_CWORD" in SCRIPTS[shell]
        return
    done = subprocess.run([program, "-n", "-c", SCRIPTS[shell]], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
