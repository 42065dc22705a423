"""Processes of benchmarks: a function is called in a process of its own."""

from __future__ import annotations

import subprocess

from bench.processes import child_command


def print_sum(first: int, second: int) -> int:
    print(first + second)
    return 3


def test_function_is_called_in_a_process_of_its_own() -> None:
    ran = subprocess.run(child_command(print_sum, first=1, second=2), capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout) == (3, "3\n"), ran.stderr
