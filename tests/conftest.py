"""Every test that needs a graph gets one of its own: a claimed DDS domain on loopback, for this test process only."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime.stack.dds import claim_domain, loopback_environment

if TYPE_CHECKING:
    from lupin_sim.host import Host

pytest_plugins = ["lupin_sim.host.fixtures"]  # a robot's computer that boots: host, fresh_host, boot_host


@pytest.fixture(scope="session", autouse=True)
def private_graph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Put this process, and all that it starts, into a DDS domain that nobody else is in."""
    claim = claim_domain()
    directory: Path = tmp_path_factory.mktemp("dds")
    before = dict(os.environ)
    os.environ.clear()
    os.environ.update(loopback_environment(claim.domain, directory, before))
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        # As in a shell's background: programs that tests interrupt would inherit it and not hear them.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield claim.domain
    os.environ.clear()
    os.environ.update(before)
    claim.release()


# Bounds by marker, in seconds: several times what the slowest test of each kind takes on two busy cores.
TIMEOUTS_S = {"mission": 1500, "host": 900, "sim": 300, "graph": 300, "browser": 300}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give every test the bound of its kind, unless it has one of its own."""
    for item in items:
        bounds = [bound for name, bound in TIMEOUTS_S.items() if item.get_closest_marker(name)]
        if bounds and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(max(bounds)))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport() -> Iterator[None]:
    """Where CI runs, everything that a test can use is there: a skip is a failure, and names what is missing."""
    outcome = yield
    assert outcome is not None
    report = outcome.get_result()
    if report.skipped and os.environ.get("LUPIN_CI_STRICT") == "1":
        report.outcome = "failed"


class GraphHost:
    """Runs nodes as the product does, each with an executor and a thread, and waits for what they bring about."""

    def __init__(self) -> None:
        import rclpy

        self.context = rclpy
        rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        self._running: list[tuple[Any, Any, threading.Thread, Any]] = []
        self._errors: list[BaseException] = []

    def add(self, node: Any) -> Any:
        """Start spinning `node`; returns it."""
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.task import Future

        executor, stop = SingleThreadedExecutor(), Future()
        executor.add_node(node)
        thread = threading.Thread(target=self._spin, args=(executor, stop), name=node.get_name(), daemon=True)
        self._running.append((node, executor, thread, stop))
        thread.start()
        return node

    def _spin(self, executor: Any, stop: Any) -> None:
        from rclpy.executors import ExternalShutdownException

        try:
            executor.spin_until_future_complete(stop)
        except ExternalShutdownException:
            pass
        except BaseException as error:  # handed to the test that waits for something else
            self._errors.append(error)

    def until(self, condition: Callable[[], Any], timeout_s: float = 20.0, what: str = "the condition") -> Any:
        """Wait until `condition()` is true and return its value; fails the test after `timeout_s`, or with the first
        exception of a node's callback."""
        deadline = time.monotonic() + timeout_s
        while True:
            if self._errors:
                raise self._errors[0]
            value = condition()
            if value:
                return value
            if time.monotonic() > deadline:
                pytest.fail(f"{what} did not come about within {timeout_s:g} s")
            time.sleep(0.002)

    def within(self, node: Any, function: Callable[[], Any]) -> Any:
        """Run a function on the thread that spins `node` and return its value.

        An action client must send from there: rclpy notes a goal as pending only after it is sent, and an answer that another
        thread's executor takes in between is dropped.
        """
        executor = next(entry[1] for entry in self._running if entry[0] is node)
        task = executor.create_task(function)
        self.until(task.done, what="the executor's turn")
        return task.result()

    def remove(self, node: Any) -> None:
        """Stop and destroy one node, as if its process had ended."""
        entry = next(entry for entry in self._running if entry[0] is node)
        self._running.remove(entry)
        self._stop(*entry)

    def _stop(self, node: Any, executor: Any, thread: threading.Thread, stop: Any) -> None:
        # The thread leaves by itself first: a shutdown destroys what a callback under way still needs.
        stop.set_result(None)
        thread.join(timeout=2.0)
        executor.shutdown(timeout_sec=2.0)
        node.destroy_node()

    def close(self) -> None:
        """Stop all nodes; a callback's exception that no wait has shown yet fails the test here."""
        while self._running:
            try:
                self._stop(*self._running.pop())
            except Exception as error:  # the others are stopped all the same: what is left lives on into the next tests
                self._errors.append(error)
        self.context.try_shutdown()
        if self._errors:
            raise self._errors[0]


@pytest.fixture
def graph_host() -> Iterator[GraphHost]:
    """A GraphHost for one test."""
    host = GraphHost()
    yield host
    host.close()


@pytest.fixture(scope="session")
def own_mounts() -> None:
    """A program can be given mounts of its own here: that takes root, and a root directory that is a mount."""
    try:
        done = subprocess.run(["unshare", "--mount", "true"], capture_output=True, text=True, check=False, timeout=20)
        missing = done.stderr.strip() if done.returncode else ""
    except OSError as error:
        missing = str(error)
    if missing:
        pytest.skip(f"needs mounts of its own: {missing}")


@pytest.fixture(scope="module")
def lupin_robot() -> Iterator[Host]:
    """A booted robot with the vendor's stack and Lupin's units, this project standing in for a release.

    One for a whole file, since a boot costs seconds.
    """
    from lupin_cli.systemd import units
    from lupin_sim.host.checkout import CURRENT_RELEASE, SETUP_LINES, keep_shared_memory, link_checkout
    from lupin_sim.host.fixtures import boot_or_skip

    with boot_or_skip(vendor_robot=True) as host:
        inside = host.robot.inside
        link_checkout(host.robot)
        keep_shared_memory(host.robot)
        for name, text in units.robot_units("mirte", CURRENT_RELEASE, SETUP_LINES).items():
            assert inside("sh", "-c", f"cat > /etc/systemd/system/{name}", stdin=text).status == 0
        done = inside(
            "sh", "-ec", "systemctl daemon-reload; systemctl enable --quiet lupin-onboard lupin-cameras lupin-auto-home"
        )
        assert done.status == 0, done.stderr
        yield host
