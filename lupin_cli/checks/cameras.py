"""Cameras that a process other than their owner holds, that are not connected, or whose driver does not work."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import command_on_robot
from lupin_cli.facts.camera_drivers import CAMERA_DRIVERS
from lupin_cli.facts.devices import DEVICES
from lupin_cli.facts.units import UNIT_STATES, VENDOR
from lupin_cli.systemd.units import CAMERAS, LUPIN_UNITS
from lupin_runtime.cameras.driver_state import ABSENT, ENDED, HELD, NO_DRIVER, DriverState

SYMPTOMS = {
    "body": "no images from the body camera: a mission finds no tags",
    "gripper": "no images from the gripper camera: a mission finds no flowers",
}
MANY_EXITS = 2  # a driver that exited once may have had its camera unplugged, and is started again
JOURNAL = "sudo journalctl --no-pager -b -u lupin-cameras -n 50"


def _running_drivers(snapshot: Snapshot) -> Mapping[str, DriverState]:
    """Return the states by camera; empty if the camera service does not run, because its files are then outdated."""
    drivers, units = snapshot.robot_fact(CAMERA_DRIVERS), snapshot.robot_fact(UNIT_STATES)
    unit = units.get(CAMERAS) if units else None
    return drivers if drivers and unit is not None and unit.running else {}


def find_held_cameras(snapshot: Snapshot) -> Iterator[Finding]:
    """A camera is held by a process outside Lupin's camera unit or, without that unit, outside the vendor's."""
    devices, units = snapshot.robot_fact(DEVICES), snapshot.robot_fact(UNIT_STATES)
    if devices is None or units is None:
        return
    lupin, vendor = units.get(CAMERAS), units.get(VENDOR)
    owner = CAMERAS if lupin and (lupin.running or lupin.active == "failed") else VENDOR if vendor and vendor.running else ""
    wrong = [holder for holder in devices.holders_of("/dev/video") if owner and holder.unit != owner]
    if wrong:
        programs = sorted(
            {f"{holder.program} ({holder.unit if holder.unit != '-' else 'started by hand'})" for holder in wrong}
        )
        # What belongs to the robot's own services is ended alone: the rest of the service must go on.
        kept = (VENDOR, *LUPIN_UNITS)
        services = sorted({holder.unit for holder in wrong if holder.unit.endswith(".service") and holder.unit not in kept})
        pids = " ".join(sorted({str(holder.pid) for holder in wrong if holder.unit not in services}))
        # A service would be started again. A process of another user is ended only by root.
        stop = [f"sudo systemctl stop {' '.join(services)}"] if services else []
        end = [f"sudo kill {pids}"] if pids else []
        yield make_finding(
            "camera-held",
            where="robot",
            cause=f"{', '.join(programs)} holds the cameras, which belong to {owner}",
            evidence=(*(holder.line() for holder in wrong), *((lupin.line(),) if lupin else ())),
            command=command_on_robot(snapshot, " && ".join((*stop, *end, f"sudo systemctl restart {owner}"))),
        )
        return
    # The depth camera is a device of the USB bus, without a /dev/video*: its driver's state shows that it is held.
    for name, driver in _running_drivers(snapshot).items():
        if driver.state == HELD:
            yield make_finding(
                "camera-held",
                where="robot",
                cause=driver.text,
                evidence=(f"{name}: {driver.text}",),
                instruction="end the program that holds the camera; the journal names it",
                command=command_on_robot(snapshot, JOURNAL),
                about=name,
            )


def find_driver_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The camera service runs, but a camera that is not switched off is not connected, or its driver does not run."""
    for name, driver in _running_drivers(snapshot).items():
        if driver.state == ABSENT:
            id = "camera-absent"
            cause = f"no {name} camera is connected: it is not plugged in, or the vendor's udev rules do not know it"
            instruction = "plug the camera in; the command lists what the robot sees on its USB"
            command = "lsusb; ls -l /dev/astra* /dev/video* 2>/dev/null; true"
        elif driver.state == NO_DRIVER:
            id, command = "camera-driver-missing", "command -v ros2 || tail -n 5 ~/.bashrc"
            instruction = "install the vendor's driver, or source its workspace; the command shows what a login shell finds"
            cause = f"the vendor's driver of the {name} camera cannot be started"
        elif driver.state == ENDED and driver.ends >= MANY_EXITS:
            id, command = "camera-driver-failing", JOURNAL
            instruction = "unplug the camera and plug it in again; the journal shows why the driver exits"
            cause = f"the driver of the {name} camera keeps exiting, {driver.ends} times so far"
        else:
            continue
        yield make_finding(
            id,
            where="robot",
            symptom=SYMPTOMS.get(name, ""),
            cause=cause,
            evidence=(f"{name}: {driver.text}",),
            instruction=instruction,
            command=command_on_robot(snapshot, command),
            about=name,
        )


CHECKS = (
    Check("cameras", find_held_cameras, robot=(DEVICES, UNIT_STATES, CAMERA_DRIVERS)),
    Check("cameras.drivers", find_driver_faults, robot=(CAMERA_DRIVERS, UNIT_STATES)),
)
