"""Asks a person for the controls of a gamepad, one by one."""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.teleop.calibration import Calibrator, can_be_calibrated
from lupin_runtime.teleop.connected_pads import input_devices
from lupin_runtime.teleop.device import Device, read_identity, read_name
from lupin_runtime.teleop.pad_maps import SIGNED_16, PadId, PadMap

_PERIOD_S = 0.02


class CalibrationFailed(Exception):
    """A control was not used in time, or the gamepad is gone; the message says what."""


@dataclass(frozen=True)
class Candidate:
    """A device that can be calibrated."""

    path: Path
    identity: PadId
    label: str


def find_candidates(devices: Path, sysfs: Path) -> list[Candidate]:
    """Return the gamepads and joysticks of this computer, also those that the table of pads does not know."""
    found = []
    for name in input_devices(devices):
        folder = sysfs / name / "device"
        try:
            identity = read_identity(folder)
        except (OSError, ValueError):
            continue  # it has disappeared
        if can_be_calibrated(identity):
            found.append(Candidate(devices / name, identity, read_name(folder) or name))
    return found


def calibrate(candidate: Candidate, timeout_s: float, ask: Callable[[str], object]) -> PadMap:
    """Return the row of a gamepad; `ask` is called with what to do next, for which there are `timeout_s` each.

    Raises CalibrationFailed, and OSError if the device cannot be read.
    """
    device = Device(candidate.path)
    try:
        axes = sorted(candidate.identity.axes)
        known = {code: limits for code, limits in device.ranges(axes).items() if limits[0] < limits[1]}
        snapshot = device.snapshot(axes)
        calibrator = Calibrator({code: known.get(code, SIGNED_16) for code in axes}, snapshot.axes if snapshot else {})
        while (step := calibrator.step) is not None:
            ask(step.prompt)
            _follow(calibrator, device, timeout_s, step.prompt)
        axis_range = known.get(calibrator.codes["forward_axis"], SIGNED_16)
        return calibrator.row(candidate.label, candidate.identity, axis_range)
    finally:
        device.close()


def _follow(calibrator: Calibrator, device: Device, timeout_s: float, prompt: str) -> None:
    """Read the device until the present step is done, and its control let go of."""
    step, deadline = calibrator.step, time.monotonic() + timeout_s
    while calibrator.step is step or calibrator.waits_for_rest:
        if time.monotonic() > deadline:
            missing = "it was not let go of" if calibrator.waits_for_rest else "nothing was noticed"
            raise CalibrationFailed(f"{prompt}: {missing} within {timeout_s:g} s")
        select.select([device.file], [], [], _PERIOD_S)
        try:
            events = device.read()
        except OSError as error:
            raise CalibrationFailed(f"the gamepad is gone: {error.strerror}") from error
        calibrator.handle(events, time.monotonic_ns())
