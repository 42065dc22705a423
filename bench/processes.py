"""Processes and graphs of benchmarks: functions in processes of their own, busy loops, and a private graph.

`python -m bench.processes MODULE:FUNCTION ARGUMENTS` calls a function with arguments in JSON; see `child_command`.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lupin_runtime.ros import LupinNode


def child_command(function: Callable[..., int | None], **arguments: Any) -> list[str]:
    """Return the command that calls a function of a module in a process of its own, and exits with what it returns."""
    spec = sys.modules[function.__module__].__spec__
    assert spec is not None  # benchmarks are run with -m
    return [sys.executable, "-m", "bench.processes", f"{spec.name}:{function.__name__}", json.dumps(arguments)]


def terminate(process: subprocess.Popen[Any], timeout_s: float = 10.0) -> None:
    """End a process, whatever it does by SIGTERM, and wait until it has ended."""
    process.terminate()
    with suppress(subprocess.TimeoutExpired):
        process.wait(timeout_s)
    kill(process)


def kill(process: subprocess.Popen[Any]) -> None:
    """Kill a process, and wait until it has ended."""
    process.kill()
    process.wait()
    if process.stdout is not None:
        process.stdout.close()


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Run busy loops for the time of a block."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"], start_new_session=True) for _ in range(count)]
    try:
        yield
    finally:
        for process in busy:
            kill(process)


@contextmanager
def private_graph() -> Iterator[dict[str, str]]:
    """Yield the environment of a graph on loopback that no other run uses, whose state is stored in a folder of its own."""
    from lupin_runtime.stack.dds import claim_domain, loopback_environment

    claim = claim_domain()
    try:
        with tempfile.TemporaryDirectory(prefix="lupin-bench-") as folder:
            yield loopback_environment(claim.domain, Path(folder), {**os.environ, "XDG_STATE_HOME": folder})
    finally:
        claim.release()


@contextmanager
def spinning_node(name: str) -> Iterator[LupinNode]:
    """Yield a node whose executor runs in a thread; call it only once in a process."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from lupin_runtime.ros import LupinNode

    rclpy.init(args=[])
    node, executor = LupinNode(name), SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    try:
        yield node
    finally:
        executor.shutdown(timeout_sec=2.0)
        rclpy.try_shutdown()
        thread.join(2.0)


def main() -> int:
    """Call the function that the command line names."""
    module, _, function = sys.argv[1].partition(":")
    return getattr(importlib.import_module(module), function)(**json.loads(sys.argv[2])) or 0


if __name__ == "__main__":
    sys.exit(main())
