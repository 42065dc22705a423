"""The simulated wall clock: unmodified programs read, set, step and slew it, but never this machine's clock."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from lupin_sim.host import Host
from lupin_sim.host.clock import Clock
from tests.support.waiting import wait_until

pytestmark = pytest.mark.host

LIST_PROCESSES = ["sh", "-c", "cat /proc/[0-9]*/comm"]
SYNC = (
    "echo 'server 10.42.0.2 iburst minpoll 0 maxpoll 0' | sudo tee /etc/chrony/sources.d/laptop.sources >/dev/null;"
    " sudo chronyc reload sources; chronyc -n waitsync 60 0 0 0.5"
)


def offset_s(host: Host) -> float:
    return float(host.robot.state["clock_offset_s"])


def date_offset_s(host: Host) -> float:
    """Return the offset of the robot's `date` to this machine's clock, to within SSH's few tens of milliseconds."""
    before = time.time()
    shown = float(host.ssh("date +%s.%N").stdout)
    return shown - (before + time.time()) / 2


@pytest.fixture(autouse=True)
def this_machines_clock_is_unchanged() -> Iterator[None]:
    wall_s, monotonic_s = time.time(), time.monotonic()
    yield
    assert abs((time.time() - wall_s) - (time.monotonic() - monotonic_s)) < 0.5


def test_shared_clock_file_reports_offset_and_rate(tmp_path: Path) -> None:
    clock = Clock(tmp_path / "page")
    assert abs(clock.offset_s) < 1e-3
    clock.disturb(offset_s=-287.5, crystal_ppm=0.0)
    assert abs(clock.offset_s + 287.5) < 1e-3
    clock.disturb(crystal_ppm=500000.0)  # 50 % too fast, so that the effect is visible at once
    before, first_s, after = time.time(), clock.offset_s, time.time()
    wait_until(lambda: time.time() > after + 0.05, "some time")
    later, second_s, latest = time.time(), clock.offset_s, time.time()
    assert (later - after) / 2 - 1e-3 < second_s - first_s < (latest - before) / 2 + 1e-3
    clock.reset()
    assert abs(clock.offset_s) < 1e-3
    assert clock.crystal_ppm == 0.0


def test_all_programs_show_the_wrong_clock(host: Host) -> None:
    with host.robot.with_fault("clock-wrong", offset_s=-7200.0):
        assert abs(date_offset_s(host) + 7200.0) < 10.0
        python = host.ssh(
            "python3 -c 'import time; print(time.time())'; date +%s; journalctl --user -n0; date +%s"
        ).stdout.split()
        assert abs(float(python[0]) - float(python[1])) < 10.0
        host.ssh("logger -t lupin-clock test; sudo journalctl --sync")
        journal = host.ssh("sudo journalctl -t lupin-clock -o short-unix --no-pager | tail -n 1").stdout.split()[0]
        assert abs(float(journal) - time.time() + 7200.0) < 30.0
    assert abs(date_offset_s(host)) < 5.0


# Waits 0.4 s on the wall clock, and prints the duration on the monotonic clock.
WAIT = """
import ctypes, time
libc = ctypes.CDLL(None)
cond, mutex = ctypes.create_string_buffer(48), ctypes.create_string_buffer(40)
deadline, start = time.time() + 0.4, time.monotonic()
at = (ctypes.c_long * 2)(int(deadline), int(deadline % 1 * 1e9))
libc.pthread_mutex_lock(mutex)
assert libc.pthread_cond_timedwait(cond, mutex, at) == 110
print(time.monotonic() - start)
"""


@pytest.mark.parametrize("offset_s", [-7200.0, 7200.0])
def test_timed_wait_on_a_wrong_clock_lasts_its_time(host: Host, offset_s: float) -> None:
    with host.robot.with_fault("clock-wrong", offset_s=offset_s):
        waited_s = float(host.robot.run_as_root("python3", "-c", WAIT).stdout)
    # Without conversion to the machine's clock it would end at once, so the caller would spin, or it would last two hours.
    assert 0.3 < waited_s < 10.0


def test_only_root_may_set_the_clock(host: Host) -> None:
    try:
        assert host.ssh("date -s 2001-01-01").returncode == 1
        assert abs(offset_s(host)) < 0.1
        assert host.ssh('sudo date -s "@$(($(date +%s) - 300))"').returncode == 0
        assert abs(offset_s(host) + 300.0) < 5.0
        assert abs(date_offset_s(host) + 300.0) < 10.0
    finally:
        host.robot.undo_fault("clock-wrong")


def test_chrony_corrects_the_clock_by_step_or_slew(fresh_host: Host) -> None:
    fresh_host.serve_ntp()
    fresh_host.robot.inject_fault("clock-wrong", offset_s=-287.5)
    synced = fresh_host.ssh(SYNC, timeout_s=90.0)
    assert synced.returncode == 0, synced
    assert fresh_host.ssh("sudo chronyc makestep").stdout.strip() == "200 OK"
    assert abs(offset_s(fresh_host)) < 0.05
    assert "10.42.0.2" in fresh_host.ssh("chronyc -n tracking").stdout
    steps = fresh_host.robot.state["clock_steps"]
    # A small offset is slewed: the clock becomes correct without a step.
    fresh_host.robot.inject_fault("clock-wrong", offset_s=0.02)
    wait_until(lambda: abs(offset_s(fresh_host)) <= 0.005, lambda: fresh_host.ssh("chronyc -n tracking").stdout)
    assert fresh_host.robot.state["clock_steps"] == steps


def test_laptops_chrony_may_run_without_serving(host: Host) -> None:
    query = (
        "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.settimeout(2)\n"
        "s.sendto(b'\\x23' + bytes(47), ('10.42.0.2', 123))\nprint(len(s.recv(99)))"
    )
    host.serve_ntp()
    assert host.robot.run_as_root("python3", "-c", query).stdout == "48\n"
    with host.robot.with_fault("chrony-not-serving"):
        wait_until(lambda: "chronyd" in host.run(LIST_PROCESSES).stdout, "a chronyd on the laptop")
        assert host.robot.run_as_root("python3", "-c", query).stdout == ""
    host.serve_ntp("off")
    assert "chronyd" not in host.run(LIST_PROCESSES).stdout


def test_chrony_measures_a_fast_crystal(fresh_host: Host) -> None:
    fresh_host.serve_ntp()
    fresh_host.robot.inject_fault("clock-drifts", ppm=120.0)
    assert fresh_host.ssh(SYNC, timeout_s=90.0).returncode == 0

    def is_measured() -> bool:
        tracking = fresh_host.ssh("chronyc -n tracking").stdout
        frequency = next(line.split() for line in tracking.splitlines() if line.startswith("Frequency"))
        measured_ppm = float(frequency[2]) * (1 if "fast" in frequency else -1)
        return abs(measured_ppm - 120.0) < 5.0

    wait_until(is_measured, lambda: fresh_host.ssh("chronyc -n tracking").stdout)


def test_clock_offset_outlives_power_cut_but_not_reset(fresh_host: Host) -> None:
    robot = fresh_host.robot
    robot.inject_fault("clock-wrong", offset_s=-900.0)
    robot.power_cut()
    robot.power_on()
    robot.wait_ready()
    assert abs(offset_s(fresh_host) + 900.0) < 1.0
    robot.factory_reset()
    assert abs(offset_s(fresh_host)) < 0.1
