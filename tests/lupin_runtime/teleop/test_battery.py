"""The charge of a gamepad's battery in folders like those of sysfs."""

from __future__ import annotations

from pathlib import Path

import pytest

from lupin_runtime.teleop.battery import battery_text


@pytest.mark.parametrize(
    ("files", "text"),
    [
        ({}, ""),
        ({"ps-controller-battery-1/capacity": "80\n", "ps-controller-battery-1/status": "Discharging\n"}, "80 %"),
        ({"nintendo_switch_controller_battery_1/capacity_level": "Low\n"}, "Low"),
        ({"battery/capacity_level": "Unknown\n"}, ""),
        ({"battery/capacity": "\u00e9"}, ""),
    ],
)
def test_charge_is_read_where_the_driver_puts_it(files: dict[str, str], text: str, tmp_path: Path) -> None:
    for name, content in files.items():
        path = tmp_path / "device" / "power_supply" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
    assert battery_text(tmp_path) == text
