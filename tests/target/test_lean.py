"""Connecting doesn't load what only `Match exec` needs, and `Match exec` works all the same."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from lupin_cli.target.lean import PutOff


def said(program: str) -> str:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    return done.stdout.strip()


def test_what_connects_does_not_load_the_task_runner() -> None:
    program = "import sys, lupin_cli.target.ssh, lupin_cli.target.destination; print('invoke.tasks' in sys.modules)"
    assert said(program) == "False"


@pytest.mark.parametrize(("command", "host"), [("true", "10.9.8.7"), ("false", "robot")])
def test_a_match_exec_line_is_obeyed(tmp_path: Path, command: str, host: str) -> None:
    (tmp_path / "config").write_text(f'Match host robot exec "{command}"\n  HostName 10.9.8.7\n')
    where = f"config_path=Path({str(tmp_path / 'config')!r})"
    program = "from pathlib import Path; from lupin_cli.target.destination import resolve"
    assert said(f"{program}; print(resolve('robot', user='u', {where}).host)") == host


def test_whoever_imports_it_gets_the_real_one() -> None:
    program = "import lupin_cli.target, invoke.tasks, invoke; print(invoke.tasks.Task.__name__, callable(invoke.run))"
    assert said(program) == "Task True"


def test_those_who_look_at_every_module_do_not_load_it() -> None:
    with pytest.raises(AttributeError):
        _ = PutOff("invoke").__file__


def test_paramiko_knows_its_version_without_what_reads_every_packages_metadata() -> None:
    program = "import sys, lupin_cli.target.ssh, paramiko; print(paramiko.__version__, 'email.message' in sys.modules)"
    assert said(program) == f"{version('paramiko')} False"


def test_whoever_wants_more_of_the_metadata_gets_the_real_one() -> None:
    want = "importlib.metadata.version('paramiko'), importlib.metadata.version('typer')"
    program = f"import lupin_cli.target, importlib.metadata; print({want}, len([*importlib.metadata.distributions()]) > 5)"
    assert said(program) == f"{version('paramiko')} {version('typer')} True"
    program = "import lupin_cli.target; from importlib.metadata import PackageNotFoundError, version\ntry: version('no-such')"
    assert said(f"{program}\nexcept PackageNotFoundError as error: print(error.name)") == "no-such"
