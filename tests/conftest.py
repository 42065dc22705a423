"""Fixtures of all tests. Each test process has a private ROS graph, a claimed DDS domain on loopback, and private settings."""

from __future__ import annotations

import inspect
import os
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

from lupin_runtime.stack.dds import claim_domain, loopback_environment
from tests.support.waiting import WAIT_S, wait_until
from tests.support.watchdog_clock import WatchdogClock

if TYPE_CHECKING:
    from lupin_sim.host import Host

# Property tests on a machine with other work: neither a slow example nor slow generation of examples is a failure.
# The examples are the same in every run, so that a change is to blame for a failure.
settings.register_profile("shared machine", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("shared machine")

pytest_plugins = [
    "lupin_sim.host.fixtures",  # simulated computers: host, fresh_host, boot_host
    "tests.support.late_errors",
]


@pytest.fixture(scope="session", autouse=True)
def private_graph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Put this process, and all processes that it starts, into an unused DDS domain; return the domain.

    They have settings, runs and logs of their own, too: not those of the user, nor of another test run.
    """
    claim = claim_domain()
    directory: Path = tmp_path_factory.mktemp("dds")
    before = dict(os.environ)
    os.environ.clear()
    os.environ.update(loopback_environment(claim.domain, directory, before))
    for name in ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "ROS_LOG_DIR"):
        os.environ[name] = str(tmp_path_factory.mktemp(name.lower()))
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        # A shell starts background jobs like this. Programs that tests interrupt would inherit it, and ignore the interrupt.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield claim.domain
    os.environ.clear()
    os.environ.update(before)
    claim.release()


# Test timeouts by marker: several times what the slowest test of each kind takes on two busy cores.
TIMEOUTS_S = {"mission": 1500, "host": 900, "sim": 300, "graph": 300, "browser": 300}


@pytest.hookimpl(tryfirst=True)  # before pytest deselects tests by their markers
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give every test the timeout of its markers, unless it has its own; make tests of booted computers and missions long.

    The check, `make test`, runs only those of them that have the marker `smoke`.
    """
    for item in items:
        booted_or_mission = item.get_closest_marker("host") or item.get_closest_marker("mission")
        if booted_or_mission and item.get_closest_marker("smoke") is None:
            item.add_marker(pytest.mark.long)
        timeouts_s = [timeout_s for name, timeout_s in TIMEOUTS_S.items() if item.get_closest_marker(name)]
        if timeouts_s and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(max(timeouts_s)))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport() -> Iterator[None]:
    """Report a skipped test as failed under LUPIN_CI_STRICT=1: CI has everything that tests need.

    A test in quarantine (xfail, with its reason) is no skipped one.
    """
    outcome = yield
    assert outcome is not None
    report = outcome.get_result()
    if report.skipped and not hasattr(report, "wasxfail") and os.environ.get("LUPIN_CI_STRICT") == "1":
        report.outcome = "failed"


class GraphHost:
    """Runs nodes as the product does, each with its own executor and thread, and waits for their effects.

    Their watchdogs wait ten times as long as in the field, but in `until_expired`.
    """

    def __init__(self) -> None:
        import rclpy

        from lupin_runtime.ros import LupinNode

        self.context = rclpy
        self.clock = WatchdogClock(slower=10)
        self._real_clock = LupinNode.monotonic_ns
        LupinNode.monotonic_ns = self.clock  # type: ignore[method-assign]
        rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
        self._running: list[tuple[Any, Any, threading.Thread, Any]] = []
        self._errors: list[BaseException] = []

    def add(self, node: Any) -> Any:
        """Start to spin `node`, and return it."""
        from lupin_runtime.ros.node_executor import NodeExecutor

        executor, stop = NodeExecutor(), threading.Event()
        executor.add_node(node)
        thread = threading.Thread(target=self._spin, args=(executor, stop), name=node.get_name(), daemon=True)
        self._running.append((node, executor, thread, stop))
        thread.start()
        return node

    def _spin(self, executor: Any, stop: Any) -> None:
        from rclpy.executors import ExternalShutdownException

        try:
            while not stop.is_set():
                executor.spin_once()
        except ExternalShutdownException:
            pass
        except BaseException as error:  # raised in the test by `until` or `close`
            self._errors.append(error)

    def until(self, condition: Callable[[], Any], timeout_s: float = WAIT_S, what: str = "the condition") -> Any:
        """Wait until `condition()` is true, and return its value.

        Fails the test after `timeout_s`. Raises the first exception of a node's callback, if there was one.
        """
        return wait_until(condition, what, timeout_s, interval_s=0.002, each=self._raise_error)

    def until_expired(self, condition: Callable[[], Any], what: str) -> Any:
        """Wait like `until` for what a watchdog does, with watchdogs that wait as long as in the field."""
        with self.clock.real():
            return self.until(condition, what=what)

    def _raise_error(self) -> None:
        if self._errors:
            raise self._errors[0]

    def within(self, node: Any, function: Callable[[], Any]) -> Any:
        """Run a function on the thread that spins `node`, and return its value.

        An action client must send its goals there: rclpy records a goal as pending only after it has sent it, and drops a
        response that another thread's executor receives in between.
        """
        executor = next(entry[1] for entry in self._running if entry[0] is node)
        task = executor.create_task(function)
        self.until(task.done, what="a free executor")
        return task.result()

    def remove(self, node: Any) -> None:
        """Stop and destroy one node, as if its process had exited."""
        entry = next(entry for entry in self._running if entry[0] is node)
        self._running.remove(entry)
        self._stop(*entry)

    def suspend(self, node: Any) -> None:
        """Stop to spin a node, which stays on the graph."""
        _, executor, _, stop = next(entry for entry in self._running if entry[0] is node)
        stop.set()
        executor.wake()

    def _stop(self, node: Any, executor: Any, thread: threading.Thread, stop: Any) -> None:
        # The thread must return first: a shutdown destroys what a running callback still needs.
        stop.set()
        executor.wake()
        thread.join()  # the test's own timeout ends a callback that hangs
        for task, *_ in executor._tasks:
            # A goal that was accepted at the very end: its coroutine never began, and would warn when it is collected.
            if inspect.iscoroutine(task._handler) and inspect.getcoroutinestate(task._handler) == inspect.CORO_CREATED:
                task._handler.close()
        executor.shutdown(timeout_sec=2.0)
        node.destroy_node()

    def close(self) -> None:
        """Stop all nodes. Raises the first exception of a callback, which fails a test that has not waited since."""
        from lupin_runtime.ros import LupinNode

        while self._running:
            try:
                self._stop(*self._running.pop())
            except Exception as error:  # the other nodes must be stopped too, or they disturb the next tests
                self._errors.append(error)
        self.context.try_shutdown()
        LupinNode.monotonic_ns = staticmethod(self._real_clock)  # type: ignore[method-assign]
        if self._errors:
            raise self._errors[0]


@pytest.fixture
def graph_host() -> Iterator[GraphHost]:
    """Return a GraphHost for one test."""
    host = GraphHost()
    yield host
    host.close()


@pytest.fixture(scope="session")
def private_mounts() -> None:
    """Skip the test unless this machine allows private mounts for a program, which needs root."""
    try:
        done = subprocess.run(["unshare", "--mount", "true"], capture_output=True, text=True, check=False, timeout=60)
        missing = done.stderr.strip() if done.returncode else ""
    except OSError as error:
        missing = str(error)
    if missing:
        pytest.skip(f"needs private mounts (unshare --mount): {missing}")


@pytest.fixture(scope="module")
def lupin_host() -> Iterator[Host]:
    """Boot a robot with the vendor's stack and Lupin's units, which run this checkout instead of a release.

    All tests of a file share it, since a boot takes seconds.
    """
    from lupin_sim.host.fixtures import boot_or_skip
    from tests.support.onboard_units import install_units

    with boot_or_skip(vendor_robot=True) as host:
        install_units(host.robot)
        done = host.robot.run_as_root("systemctl", "enable", "--quiet", "lupin-onboard", "lupin-cameras", "lupin-auto-home")
        assert done.status == 0, done.stderr
        yield host
