"""What is started for the live specs of the page ends with them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from lupin_runtime.stack.runs import Run
from tests.support.waiting import wait_until
from tools import live_specs
from tools.build_page import ROOT
from tools.live_specs import processes_beside

WRITES_PID = """
import os, pathlib, sys, time
print("started", flush=True)
pathlib.Path(sys.argv[1]).write_text(str(os.getpid()))
time.sleep(60)
"""


def test_processes_beside_a_run_end_with_a_failure(tmp_path: Path) -> None:
    files = [tmp_path / "one", tmp_path / "two"]

    def start_and_fail() -> None:
        with processes_beside(tmp_path) as start:
            for file in files:
                start(file.name, [sys.executable, "-c", WRITES_PID, str(file)])
            wait_until(lambda: all(file.exists() and file.read_text() for file in files), "both processes")
            raise OSError("a spec failed")

    with pytest.raises(OSError, match="a spec failed"):
        start_and_fail()
    assert (tmp_path / "one.log").read_text() == "started\n"
    assert not any(psutil.pid_exists(int(file.read_text())) for file in files)


PLAYWRIGHT = """#!/bin/sh
echo "$@ $LUPIN_CONSOLE $LUPIN_RUN $LUPIN_CHROMIUM" > asked
exit 3
"""


def test_specs_get_their_run_and_return_their_status(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "node_modules" / ".bin" / "playwright"
    program.parent.mkdir(parents=True)
    program.write_text(PLAYWRIGHT)
    program.chmod(0o755)
    monkeypatch.setattr(live_specs, "WEB", tmp_path)
    monkeypatch.setattr(live_specs, "node_path", lambda: os.environ["PATH"])
    monkeypatch.setattr(live_specs, "install_packages", lambda _: None)
    monkeypatch.setattr(live_specs, "read_description", lambda _: SimpleNamespace(url="http://127.0.0.1:8090/"))
    run = Run(tmp_path / "20261124-120000-0000")
    assert live_specs.run_specs(run, "/usr/bin/chromium", ["loss"]) == 3
    assert (tmp_path / "asked").read_text() == f"test loss http://127.0.0.1:8090 {run.path} /usr/bin/chromium\n"


def test_live_specs_without_browser_name_the_package(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "tools" / "build_page.py", "live"],
        env={**os.environ, "PATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr == "the live specs: there is no Chromium: apt-get install chromium\n"
