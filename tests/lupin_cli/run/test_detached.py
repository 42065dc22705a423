"""A run that is started in the background: it is up, it dies early, or it never begins. The children are real processes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from lupin_cli.run import detached
from lupin_cli.run.detached import Started, start

BEGIN = (
    "import os, sys, time\n"
    "from lupin_runtime.stack.runs import create_run\n"
    "run, lock = create_run()\n"
    "run.write_info({'pid': os.getpid()})\n"
    "def stages(**phases):\n"
    "    return [{'name': n, 'phase': p, 'optional': n == 'console', 'up_after_s': 2.5} for n, p in phases.items()]\n"
)


@pytest.fixture
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return []


def end(started: Started) -> None:
    started.child.kill()
    started.child.wait()


def python(program: str) -> list[str]:
    return [sys.executable, "-c", program]


def test_start_returns_once_all_needed_processes_are_up(shown: list[str]) -> None:
    program = BEGIN + (
        "run.write_state({'stages': stages(sim='up', nav='waiting')}); time.sleep(0.3)\n"
        "run.write_state({'stages': stages(sim='up', nav='up', console='failed')}); time.sleep(60)\n"
    )
    started = start(python(program), shown.append)
    end(started)
    assert started.run is not None
    assert (started.exit_status, started.text, started.up_after_s, started.processes) == (0, "", 2.5, 2)
    assert shown[0] == f"run {started.run.id} has started" and ", ".join(shown[1:]).count("sim") == 1


def test_early_death_is_reported_with_its_cause(shown: list[str]) -> None:
    program = BEGIN + (
        "run.write_state({'stages': stages(sim='failed'), 'outcome': {'exit_status': 3, 'failed_process': 'sim',\n"
        "    'sentence': 'sim exited with status 1: ValueError: seed'}})\n"
        "time.sleep(60)\n"  # it still builds its report
    )
    started = start(python(program), shown.append)
    end(started)
    assert (started.exit_status, started.text) == (3, "sim exited with status 1: ValueError: seed")
    assert started.failed_process == "sim"


@pytest.mark.parametrize("begin", ["import sys\n", BEGIN])
def test_child_that_exits_at_once_passes_its_error_on(shown: list[str], begin: str) -> None:
    started = start(python(begin + "print('the disk is full', file=sys.stderr); sys.exit(2)"), shown.append)
    assert (started.exit_status, started.text) == (2, "the disk is full")


def test_child_that_starts_no_run_is_ended(shown: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detached, "START_TIMEOUT_S", 0.3)
    started = start(python("import time; time.sleep(60)"), shown.append)
    end(started)
    assert started.exit_status == 3 and "no run has started" in started.text
