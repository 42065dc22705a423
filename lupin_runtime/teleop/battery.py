"""The charge of a gamepad's battery, as the kernel reports it.

For some gamepads the kernel asks the pad itself, which takes until it answers: what drives a robot must not read this.
"""

from __future__ import annotations

from pathlib import Path


def battery_text(folder: Path) -> str:
    """Return the charge, such as `80 %` or `Low`, of a device by its folder in sysfs, such as /sys/class/input/event7/device.

    Empty if the gamepad has no battery or does not tell.
    """
    # The input device and its battery are both children of the gamepad's HID device.
    for supply in sorted((folder / "device" / "power_supply").glob("*")):
        for name, unit in (("capacity", " %"), ("capacity_level", "")):
            try:
                text = (supply / name).read_text(encoding="ascii").strip()
            except (OSError, ValueError):
                continue
            if text and text != "Unknown":
                return f"{text}{unit}"
    return ""
