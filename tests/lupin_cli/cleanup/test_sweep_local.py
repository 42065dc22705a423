"""`lupin sweep` on real ROS processes and shared memory, in namespaces that isolate them from the rest of this machine."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.waiting import wait_until

pytestmark = pytest.mark.graph

NODE = """
import rclpy, time
rclpy.init(args=[])
node = rclpy.create_node("left_over")
print("up", flush=True)
while True:
    time.sleep(1)
"""
TIMEOUT_S = 60.0


class Sandbox:
    """A PID and mount namespace with its own /dev/shm: a sweep in it cannot touch anything outside."""

    def __init__(self, state_home: Path) -> None:
        kind = ["--map-root-user"] if os.geteuid() else []
        # The first process is called like an init, which adopts orphans; as a shell, it would have started them.
        setup = "mount -t tmpfs none /dev/shm && printf init >/proc/1/comm && echo ready && while :; do sleep 1; done"
        self._holder = subprocess.Popen(
            ["unshare", *kind, "--mount", "--pid", "--fork", "--mount-proc", "--kill-child", "sh", "-c", setup],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self._holder.stdout is not None and self._holder.stderr is not None
        if self._holder.stdout.readline() != "ready\n":
            self._holder.kill()
            pytest.skip(f"no namespaces here: {self._holder.communicate(timeout=60)[1].strip()}")
        inner = subprocess.run(
            ["pgrep", "-P", str(self._holder.pid)], capture_output=True, text=True, timeout=60
        ).stdout.strip()
        self._enter = ["nsenter", "-t", inner, "-m", "-p", *(["-U", "--preserve-credentials"] if kind else []), "--"]
        self.environment = {key: value for key, value in os.environ.items() if key != "FASTRTPS_DEFAULT_PROFILES_FILE"}
        self.environment.update(ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", XDG_STATE_HOME=str(state_home))
        self._shm = Path(f"/proc/{inner}/root/dev/shm")
        self._nodes: list[subprocess.Popen[str]] = []

    def node(self, script: str, **environment: str) -> tuple[subprocess.Popen[str], set[str]]:
        """Start a shell that runs a node as "$@". Returns the shell and the files that appeared in /dev/shm."""
        before = self.files()
        command = [*self._enter, "sh", "-c", script, "sh", sys.executable, "-c", NODE]
        variables = {**self.environment, **environment}
        process = subprocess.Popen(command, env=variables, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._nodes.append(process)
        assert process.stdout is not None and process.stdout.readline() == "up\n"
        return process, self.files() - before

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([*self._enter, *command], env=self.environment, capture_output=True, text=True, timeout=TIMEOUT_S)

    def sweep(self, *arguments: str) -> tuple[int, dict[str, Any]]:
        """Run `lupin sweep --json`. Returns its exit status and output."""
        done = self.run(sys.executable, "-m", "lupin_cli.app", "sweep", "--local", "--json", *arguments)
        assert done.stdout, done.stderr
        return done.returncode, json.loads(done.stdout)

    def files(self) -> set[str]:
        return {path.name for path in self._shm.iterdir() if "fastrtps" in path.name}

    def stale_process(self) -> dict[str, Any]:
        """Wait until a dry run plans to terminate exactly one process, and return it."""
        process: dict[str, Any]
        (process,) = wait_until(lambda: self.sweep("--dry-run")[1]["culprits"], "a stale process")
        return process

    def is_alive(self, pid: int) -> bool:
        return self.run("grep", "-q", "^State:.[^Z]", f"/proc/{pid}/status").returncode == 0

    def close(self) -> None:
        self._holder.kill()
        self._holder.communicate(timeout=60)
        for process in self._nodes:
            process.wait(60)
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()


@pytest.fixture
def sandbox(tmp_path: Path) -> Iterator[Sandbox]:
    new_sandbox = Sandbox(tmp_path)
    yield new_sandbox
    new_sandbox.close()


ORPHAN = '"$@" & read line; exit'  # the shell exits at the end of its input, so the node loses its parent
WATCH = '"$@" & echo $! >&2; wait'
KILLED = '"$@" & pid=$!; read line; kill -9 $pid; wait $pid; read line'


def files_of(plan: dict[str, Any], key: str) -> set[str]:
    return {name for segment in plan[key] for name in segment["files"]}


def test_memory_of_killed_process_is_removed_of_live_one_kept(sandbox: Sandbox) -> None:
    dying, dying_files = sandbox.node(KILLED)
    # In another domain: within a second, Fast DDS removes the memory of a dead process whose messages it has read.
    _, live_files = sandbox.node(WATCH, ROS_DOMAIN_ID="101")
    assert len(dying_files) >= 5
    status, plan = sandbox.sweep("--dry-run")
    assert status == 0 and plan["orphans"] == plan["culprits"] == []
    assert dying.stdin is not None
    dying.stdin.write("\n")
    dying.stdin.flush()
    # The kernel releases the files of a killed process one by one, and the live process may take over a dead one's port file.
    dead_files = dying_files - live_files
    segments = {name for name in dead_files if "port" not in name}
    wait_until(lambda: segments <= files_of(sandbox.sweep("--dry-run")[1], "orphans"), "all segments of the dead process")
    status, plan = sandbox.sweep("--dry-run")
    assert status == 1 and segments and segments <= files_of(plan, "orphans") <= dead_files
    assert segments | live_files <= sandbox.files() <= dying_files | live_files  # it was a dry run
    status, result = sandbox.sweep()
    removed = files_of(result, "removed")
    assert status == 0 and segments <= removed <= dead_files and result["failed"] == []
    left = sandbox.files()
    assert live_files <= left and not left & segments
    taken_over = {name for name in left - live_files if not name.startswith("sem.")}  # whose lock stays with it
    assert taken_over <= mapped_files() and all(name in dead_files for name in left - live_files)
    assert sandbox.sweep()[1]["removed"] == []


def mapped_files() -> set[str]:
    """Return the names of all files that a process has mapped."""
    names = set[str]()
    for path in Path("/proc").glob("[0-9]*/maps"):
        with contextlib.suppress(OSError):  # it has ended
            names.update(line.rpartition("/")[2] for line in path.read_text(errors="replace").splitlines())
    return names


def test_process_with_live_parent_is_named_and_kept(sandbox: Sandbox) -> None:
    _, files = sandbox.node(WATCH)
    status, result = sandbox.sweep()
    assert status == 0 and result["ended"] == [] and sandbox.files() == files
    assert any("is alive; terminate it there" in kept["why"] for kept in result["kept"])


@pytest.mark.parametrize("stopped", [False, True], ids=["running", "stopped"])
def test_process_without_parent_and_its_memory_are_removed(sandbox: Sandbox, stopped: bool) -> None:
    shell, files = sandbox.node(ORPHAN)
    assert shell.stdin is not None and files
    shell.stdin.close()
    shell.wait(TIMEOUT_S)
    stale = sandbox.stale_process()
    assert stale["why"] == "its parent process is gone" and stale["ports"] and "left_over" in stale["command"]
    if stopped:
        sandbox.run("kill", "-s", "STOP", str(stale["pid"]))
    status, result = sandbox.sweep()
    assert status == 0 and [each["pid"] for each in result["ended"]] == [stale["pid"]]
    assert not sandbox.is_alive(stale["pid"]) and sandbox.files() == set()
