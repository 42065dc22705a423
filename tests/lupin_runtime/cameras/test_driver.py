"""Keeps a camera's driver running, with real processes that hold a device file in a temporary root folder."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

from lupin_runtime.cameras import driver
from lupin_runtime.cameras.configuration import CameraConfiguration, Gripper
from lupin_runtime.cameras.devices import GRIPPER
from lupin_runtime.cameras.driver_state import ABSENT, ENDED, HELD, NO_DRIVER, OFF, RUNNING
from lupin_runtime.cameras.holders import find_holders, terminate
from tests.support.waiting import WAIT_S, wait_for_nothing, wait_until

# Keeps the file in its first argument open, as a camera driver does; with a second argument it ignores all signals but SIGKILL.
HOLD = """#!{python}
import signal, sys, time
file = open(sys.argv[1])
if len(sys.argv) > 2:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("holds", flush=True)
time.sleep(600)
"""

Hold = Callable[..., "subprocess.Popen[bytes]"]


@pytest.fixture
def device(tmp_path: Path) -> Path:
    """The gripper camera's device file, with its name in sysfs."""
    folder = tmp_path / "sys/class/video4linux/video2"
    folder.mkdir(parents=True)
    (folder / "name").write_text("USB 2.0 PC Cam\n")
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev/video2").touch()
    return tmp_path / "dev/video2"


@pytest.fixture
def hold(tmp_path: Path) -> Iterator[Hold]:
    """Starts programs with a chosen name that hold a file."""
    running: list[subprocess.Popen[bytes]] = []

    def start(program: str, file: Path, *arguments: str) -> subprocess.Popen[bytes]:
        path = tmp_path / program
        path.write_text(HOLD.format(python=sys.executable))
        path.chmod(0o755)
        process = subprocess.Popen([str(path), str(file), *arguments], stdout=subprocess.PIPE)
        running.append(process)
        assert process.stdout is not None and process.stdout.readline() == b"holds\n"
        return process

    yield start
    for process in running:
        process.kill()
        process.communicate()


@pytest.fixture
def ros2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install a fake `ros2`, whose driver process holds the device and gets no signals; the value is its log of calls."""
    calls = tmp_path / "calls"
    programs = tmp_path / "bin"
    programs.mkdir()
    (programs / "usb_cam_node_exe").write_text(HOLD.format(python=sys.executable))
    script = f'#!/bin/sh\necho "$@" >> {calls}\n{programs}/usb_cam_node_exe {tmp_path}/dev/video2 & wait\n'
    (programs / "ros2").write_text(script)
    for path in programs.iterdir():
        path.chmod(0o755)
    calls.touch()
    shell = shutil.which("sh")
    assert shell is not None
    monkeypatch.setenv("PATH", f"{programs}:{Path(shell).parent}:/usr/bin:/bin")
    monkeypatch.setattr(driver, "CAMERA_CHECK_PERIOD_S", 0.05)
    monkeypatch.setattr(driver, "RESTART_DELAY_S", 0.05)
    return calls


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], dict[str, Any]]:
    """Reads the state that the doctor would see; empty if there is none yet."""
    folder = tmp_path / "run"
    folder.mkdir()
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(folder))
    file = folder / "gripper.json"
    return lambda: json.loads(file.read_text()) if file.exists() else {"state": ""}


@pytest.fixture
def camera_driver(tmp_path: Path) -> Iterator[Callable[..., None]]:
    """Starts a driver of the gripper camera, which is stopped after the test."""
    ended = threading.Event()
    threads: list[threading.Thread] = []

    def start(configuration: CameraConfiguration | None = None) -> None:
        runs = driver.CameraDriver(GRIPPER, configuration or CameraConfiguration(), ended, tmp_path)
        threads.append(threading.Thread(target=runs.run))
        threads[-1].start()

    yield start
    ended.set()
    for thread in threads:
        thread.join(WAIT_S)
        assert not thread.is_alive()


def test_holders_are_found_with_their_programs(device: Path, hold: Hold, tmp_path: Path) -> None:
    assert find_holders([device]) == []
    (tmp_path / "other").touch()
    hold("innocent", tmp_path / "other")
    driver_process, person = hold("usb_cam_node_exe", device), hold("cheese", device)
    found = {holder.pid: (holder.program, holder.is_driver, holder.device) for holder in find_holders([device])}
    assert found == {
        driver_process.pid: ("usb_cam_node_exe", True, str(device)),
        person.pid: ("cheese", False, str(device)),
    }


@pytest.mark.parametrize("deaf", [(), ("deaf",)], ids=["hears", "deaf"])
def test_driver_is_terminated_by_its_pid(
    device: Path, hold: Hold, deaf: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    import signal

    monkeypatch.setattr(
        "lupin_runtime.cameras.holders._SIGNALS", ((signal.SIGINT, 0.3), (signal.SIGTERM, 0.3), (signal.SIGKILL, 5.0))
    )
    process = hold("usb_cam_node_exe", device, *deaf)
    (holder,) = find_holders([device])
    assert terminate(holder)
    process.wait(WAIT_S)
    assert terminate(holder), "it has already exited"


def test_vendors_driver_is_replaced(device: Path, hold: Hold, ros2: Path, camera_driver: Callable[..., None]) -> None:
    vendor = hold("usb_cam_node_exe", device)
    camera_driver()
    vendor.wait(WAIT_S)
    wait_until(lambda: ros2.read_text().count("\n") == 1, "the start of our driver")
    wait_until(lambda: len(find_holders([device])) == 1, "our driver on the device")


def test_other_program_is_named_and_not_terminated(
    device: Path, hold: Hold, ros2: Path, camera_driver: Callable[..., None], capfd: pytest.CaptureFixture[str]
) -> None:
    person = hold("cheese", device)
    camera_driver()
    said = wait_until(lambda: capfd.readouterr().out, "a message")
    assert f"held by cheese (process {person.pid})" in said and f"kill {person.pid}" in said
    wait_for_nothing(0.3, "the start of our driver")
    assert person.poll() is None and ros2.read_text() == ""
    person.kill()
    wait_until(ros2.read_text, "the start of our driver")


def test_driver_starts_again_when_camera_returns(
    device: Path, ros2: Path, camera_driver: Callable[..., None], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    name = tmp_path / "sys/class/video4linux/video2/name"
    name.rename(tmp_path / "unplugged")
    camera_driver()
    wait_until(lambda: "no gripper camera is connected" in capfd.readouterr().out, "a message")
    (tmp_path / "unplugged").rename(name)
    wait_until(lambda: ros2.read_text().count("\n") == 1, "the start of the driver")
    (ours,) = wait_until(lambda: find_holders([device]), "the driver on the device")
    name.rename(tmp_path / "unplugged")
    psutil.Process(ours.pid).kill()
    wait_until(lambda: "no gripper camera is connected" in capfd.readouterr().out, "a message")
    (tmp_path / "unplugged").rename(name)
    wait_until(lambda: ros2.read_text().count("\n") == 2, "the next start")


def test_stopping_leaves_no_process(device: Path, ros2: Path, tmp_path: Path) -> None:
    ended = threading.Event()
    thread = threading.Thread(target=driver.CameraDriver(GRIPPER, CameraConfiguration(), ended, tmp_path).run)
    thread.start()
    wait_until(lambda: find_holders([device]), "the driver on the device")
    ended.set()
    thread.join(WAIT_S)
    assert not thread.is_alive() and ros2.read_text().count("\n") == 1
    wait_until(lambda: find_holders([device]) == [], "the end of the driver")


def test_driver_of_switched_off_camera_does_not_start(
    device: Path, ros2: Path, camera_driver: Callable[..., None], capfd: pytest.CaptureFixture[str]
) -> None:
    assert device.exists()
    camera_driver(CameraConfiguration(gripper=Gripper(enabled=False)))
    wait_until(lambda: "is switched off in /etc/lupin/cameras.yaml" in capfd.readouterr().out, "a message")
    wait_for_nothing(0.3, "the start of our driver")
    assert ros2.read_text() == ""


def test_missing_vendor_software_is_reported(
    device: Path, camera_driver: Callable[..., None], capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert device.exists()
    monkeypatch.setenv("PATH", "/nonexistent")
    camera_driver()
    wait_until(lambda: "ros2 cannot be started" in capfd.readouterr().out, "a message")


@pytest.mark.usefixtures("ros2")
def test_every_state_is_written_for_the_doctor(
    device: Path, hold: Hold, camera_driver: Callable[..., None], kept: Callable[[], dict[str, Any]], tmp_path: Path
) -> None:
    name = tmp_path / "sys/class/video4linux/video2/name"
    name.rename(tmp_path / "unplugged")
    camera_driver()
    wait_until(lambda: kept()["state"] == ABSENT, "the absent camera")
    person = hold("cheese", device)
    (tmp_path / "unplugged").rename(name)
    wait_until(lambda: kept()["state"] == HELD, "the held camera")
    assert f"cheese (process {person.pid})" in kept()["text"]
    person.kill()
    wait_until(lambda: kept()["state"] == RUNNING, "the running driver")
    for ends in (1, 2, 3):
        (ours,) = wait_until(lambda: find_holders([device]), "the driver on the device")
        psutil.Process(ours.pid).kill()
        wait_until(partial(lambda count: kept()["ends"] == count, ends), f"end {ends}")
        assert kept()["state"] == ENDED
    assert kept()["text"].endswith("3 times in a row")


@pytest.mark.usefixtures("ros2")
def test_exit_count_restarts_after_a_stable_run(
    device: Path,
    camera_driver: Callable[..., None],
    kept: Callable[[], dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(driver, "STABLE_AFTER_S", 0.3)
    camera_driver()
    (ours,) = wait_until(lambda: find_holders([device]), "the driver on the device")
    wait_until(lambda: kept()["state"] == RUNNING, "the running driver")
    psutil.Process(ours.pid).kill()
    wait_until(lambda: kept()["state"] == ENDED, "the end")
    wait_until(
        lambda: kept() == {"state": RUNNING, "text": "the driver of the gripper camera runs", "ends": 0}, "the next driver"
    )


def test_missing_software_and_off_state_are_written(
    device: Path, camera_driver: Callable[..., None], kept: Callable[[], dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert device.exists()
    monkeypatch.setenv("PATH", "/nonexistent")
    camera_driver()
    wait_until(lambda: kept()["state"] == NO_DRIVER, "the missing driver")
    camera_driver(CameraConfiguration(gripper=Gripper(enabled=False)))
    wait_until(lambda: kept()["state"] == OFF, "the camera that is switched off")


@pytest.mark.usefixtures("ros2")
def test_unwritable_state_does_not_stop_the_driver(
    device: Path, camera_driver: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RUNTIME_DIRECTORY", "/nonexistent")
    camera_driver()
    wait_until(lambda: find_holders([device]), "the driver on the device")
