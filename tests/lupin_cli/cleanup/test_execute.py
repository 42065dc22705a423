"""The script that removes stale files of shared memory, in a folder where everybody may plant links and FIFOs."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from lupin_cli.cleanup.execute import _REMOVE
from lupin_cli.facts.shared_memory import PROBE


def run_in_own_shm(script: str) -> subprocess.CompletedProcess[str]:
    """Run a script in a mount namespace with an empty /dev/shm."""
    kind = ["--map-root-user"] if os.geteuid() else []
    command = ["unshare", *kind, "--mount", "sh", "-c", f"mount -t tmpfs -o mode=1777 none /dev/shm && {script}"]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=60)
    if "unshare" in ran.stderr or "mount:" in ran.stderr:
        pytest.skip(f"no namespaces here: {ran.stderr.strip()}")
    return ran


def test_lock_that_is_a_link_creates_nothing(tmp_path: Path) -> None:
    ran = run_in_own_shm(f"touch /dev/shm/fastrtps_1; ln -s {tmp_path}/cron /dev/shm/fastrtps_1_el\n{_REMOVE}\n"
                         "remove fastrtps_1_el fastrtps_1 fastrtps_1_el")  # fmt: skip
    assert ran.stdout == "stays fastrtps_1\n"
    assert list(tmp_path.iterdir()) == []


def test_lock_that_is_a_fifo_is_not_opened() -> None:
    ran = run_in_own_shm(f"touch /dev/shm/fastrtps_1; mkfifo /dev/shm/fastrtps_1_el\n({PROBE})\n{_REMOVE}\n"
                         "remove fastrtps_1_el fastrtps_1 fastrtps_1_el")  # fmt: skip
    assert "@@ tried\n@@ end\nstays fastrtps_1\n" in ran.stdout


def test_free_lock_lets_its_files_be_removed() -> None:
    ran = run_in_own_shm(f"cd /dev/shm; touch fastrtps_1 fastrtps_1_el sem.fastrtps_1_mutex\n{_REMOVE}\n"
                         "remove fastrtps_1_el fastrtps_1 fastrtps_1_el sem.fastrtps_1_mutex; ls /dev/shm")  # fmt: skip
    assert ran.stdout == "removed fastrtps_1\n"


def test_held_lock_keeps_its_files() -> None:
    ran = run_in_own_shm(f"cd /dev/shm; touch fastrtps_1 fastrtps_1_el; exec 8<fastrtps_1_el; flock -s 8\n{_REMOVE}\n"
                         "remove fastrtps_1_el fastrtps_1 fastrtps_1_el; ls /dev/shm")  # fmt: skip
    assert ran.stdout == "stays fastrtps_1\nfastrtps_1\nfastrtps_1_el\n"
