"""The robot's own wall clock: wrong, set, stepped and slewed by unmodified programs, and never this machine's."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from lupin_sim.host import Host
from lupin_sim.host.clock import Clock
from lupin_sim.host.fixtures import until

pytestmark = pytest.mark.host

PROCESSES = ["sh", "-c", "cat /proc/[0-9]*/comm"]
SYNC = (
    "echo 'server 10.42.0.2 iburst minpoll 0 maxpoll 0' | sudo tee /etc/chrony/sources.d/laptop.sources >/dev/null;"
    " sudo chronyc reload sources; chronyc -n waitsync 60 0 0 0.5"
)


def offset_s(host: Host) -> float:
    return float(host.robot.state["clock_offset_s"])


def said_offset_s(host: Host) -> float:
    """What the robot's own `date` says, against this machine's clock, as well as SSH's few tens of milliseconds allow."""
    before = time.time()
    said = float(host.ssh("date +%s.%N").stdout)
    return said - (before + time.time()) / 2


@pytest.fixture(autouse=True)
def this_machines_clock_is_let_be() -> Iterator[None]:
    wall_s, monotonic_s = time.time(), time.monotonic()
    yield
    assert abs((time.time() - wall_s) - (time.monotonic() - monotonic_s)) < 0.5


def test_a_clock_page_shows_its_offset_and_its_crystal(tmp_path: Path) -> None:
    clock = Clock(tmp_path / "page")
    assert abs(clock.offset_s) < 1e-3
    clock.make_wrong(offset_s=-287.5, crystal_ppm=0.0)
    assert abs(clock.offset_s + 287.5) < 1e-3
    clock.make_wrong(crystal_ppm=500000.0)  # half as fast again, so that it shows at once
    began_s, began = clock.offset_s, time.time()
    time.sleep(0.05)
    assert clock.offset_s - began_s == pytest.approx((time.time() - began) / 2, rel=0.3)
    clock.reset()
    assert abs(clock.offset_s) < 1e-3
    assert clock.crystal_ppm == 0.0


def test_a_wrong_clock_is_what_every_program_there_shows(host: Host) -> None:
    with host.robot.broken("clock-wrong", offset_s=-7200.0):
        assert abs(said_offset_s(host) + 7200.0) < 10.0
        python = host.ssh(
            "python3 -c 'import time; print(time.time())'; date +%s; journalctl --user -n0; date +%s"
        ).stdout.split()
        assert abs(float(python[0]) - float(python[1])) < 10.0
        host.ssh("logger -t lupin-clock here; sudo journalctl --sync")
        journal = host.ssh("sudo journalctl -t lupin-clock -o short-unix --no-pager | tail -n 1").stdout.split()[0]
        assert abs(float(journal) - time.time() + 7200.0) < 30.0
    assert abs(said_offset_s(host)) < 5.0


# Waits 0.4 s by the wall clock, and prints how long that was by the other one.
WAIT = """
import ctypes, time
libc = ctypes.CDLL(None)
cond, mutex = ctypes.create_string_buffer(48), ctypes.create_string_buffer(40)
until, began = time.time() + 0.4, time.monotonic()
at = (ctypes.c_long * 2)(int(until), int(until % 1 * 1e9))
libc.pthread_mutex_lock(mutex)
assert libc.pthread_cond_timedwait(cond, mutex, at) == 110
print(time.monotonic() - began)
"""


@pytest.mark.parametrize("offset_s", [-7200.0, 7200.0])
def test_a_wait_until_a_time_of_the_wall_clock_ends_then(host: Host, offset_s: float) -> None:
    with host.robot.broken("clock-wrong", offset_s=offset_s):
        waited_s = float(host.robot.inside("python3", "-c", WAIT).stdout)
    # Else it is over at once, and its caller spins; or it lasts for two hours.
    assert 0.3 < waited_s < 10.0


def test_root_may_set_it_and_nobody_else(host: Host) -> None:
    try:
        assert host.ssh("date -s 2001-01-01").returncode == 1
        assert abs(offset_s(host)) < 0.1
        assert host.ssh('sudo date -s "@$(($(date +%s) - 300))"').returncode == 0
        assert abs(offset_s(host) + 300.0) < 5.0
        assert abs(said_offset_s(host) + 300.0) < 10.0
    finally:
        host.robot.mend("clock-wrong")


def test_chrony_measures_the_laptop_and_steps_the_clock_right(fresh_host: Host) -> None:
    fresh_host.serve_ntp()
    fresh_host.robot.fault("clock-wrong", offset_s=-287.5)
    synced = fresh_host.ssh(SYNC, timeout_s=90.0)
    assert synced.returncode == 0, synced
    assert fresh_host.ssh("sudo chronyc makestep").stdout.strip() == "200 OK"
    assert abs(offset_s(fresh_host)) < 0.05
    assert "10.42.0.2" in fresh_host.ssh("chronyc -n tracking").stdout
    steps = fresh_host.robot.state["clock_steps"]
    # Off by little, it is slewed: it gets right and nothing jumps.
    fresh_host.robot.fault("clock-wrong", offset_s=0.02)
    deadline = time.monotonic() + 60.0
    while abs(offset_s(fresh_host)) > 0.005:
        assert time.monotonic() < deadline, fresh_host.ssh("chronyc -n tracking").stdout
        time.sleep(0.2)
    assert fresh_host.robot.state["clock_steps"] == steps


def test_a_laptop_that_runs_chrony_need_not_serve(host: Host) -> None:
    query = (
        "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.settimeout(2)\n"
        "s.sendto(b'\\x23' + bytes(47), ('10.42.0.2', 123))\nprint(len(s.recv(99)))"
    )
    host.serve_ntp()
    assert host.robot.inside("python3", "-c", query).stdout == "48\n"
    with host.robot.broken("chrony-not-serving"):
        until(lambda: "chronyd" in host.run(PROCESSES).stdout, "a chronyd on the laptop")
        assert host.robot.inside("python3", "-c", query).stdout == ""
    host.serve_ntp("off")
    assert "chronyd" not in host.run(PROCESSES).stdout


def test_a_crystal_that_runs_fast_is_measured_by_chrony(fresh_host: Host) -> None:
    fresh_host.serve_ntp()
    fresh_host.robot.fault("clock-drifts", ppm=120.0)
    assert fresh_host.ssh(SYNC, timeout_s=90.0).returncode == 0
    deadline = time.monotonic() + 60.0
    while True:
        said = fresh_host.ssh("chronyc -n tracking").stdout
        frequency = next(line.split() for line in said.splitlines() if line.startswith("Frequency"))
        measured_ppm = float(frequency[2]) * (1 if "fast" in frequency else -1)
        if abs(measured_ppm - 120.0) < 5.0:
            break
        assert time.monotonic() < deadline, said
        time.sleep(0.5)


def test_the_clock_goes_on_over_a_power_cut_and_is_right_on_a_new_robot(fresh_host: Host) -> None:
    robot = fresh_host.robot
    robot.fault("clock-wrong", offset_s=-900.0)
    robot.power_cut()
    robot.power_on()
    robot.wait_ready()
    assert abs(offset_s(fresh_host) + 900.0) < 1.0
    robot.renew()
    assert abs(offset_s(fresh_host)) < 0.1
