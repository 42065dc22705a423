"""Two tiny wheels are merged into one that pip installs, with the requirements and files of both."""

from __future__ import annotations

import subprocess
import sys
from email import message_from_bytes
from pathlib import Path

import pytest
from wheel.wheelfile import WheelFile

from tools.build_wheel import locked_pins, merge

PINS = ["ros-jazzy-rclpy==7.1.6", "ros-fastcdr==2.2.7"]
TAG = "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"


def write_wheel(folder: Path, name: str, files: dict[str, str], requirements: tuple[str, ...] = ()) -> Path:
    distribution = f"{name.replace('-', '_')}-0.1.0"
    metadata = [f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1.0", *(f"Requires-Dist: {each}" for each in requirements)]
    path = folder / f"{distribution}-py3-none-any.whl"
    with WheelFile(path, "w") as wheel:
        for file, content in files.items():
            wheel.writestr(file.replace("DATA", f"{distribution}.data"), content)
        wheel.writestr(f"{distribution}.dist-info/METADATA", "\n".join(metadata) + "\n")
        wheel.writestr(f"{distribution}.dist-info/WHEEL", TAG)
        wheel.writestr(f"{distribution}.dist-info/entry_points.txt", "" if requirements else "[never]\nmerged = no:no\n")
    return path


@pytest.fixture
def merged(tmp_path: Path) -> Path:
    lupin = write_wheel(
        tmp_path,
        "lupin",
        {"lupin_cli/__init__.py": "NAME = 'lupin'\n", "DATA/data/share/lupin/a.txt": "a\n"},
        ("typer>=0.28", "ros-jazzy-rclpy[fastrtps]==7.1.6; platform_machine == 'x86_64'", "lupin-interfaces==0.1.0"),
    )
    interfaces = write_wheel(
        tmp_path, "lupin-interfaces", {"lupin_msgs/__init__.py": "NAME = 'msgs'\n", "DATA/data/share/lupin_msgs/b.msg": "b\n"}
    )
    return merge(lupin, interfaces, tmp_path / "dist", PINS)


def test_merged_wheel_has_the_files_of_both(merged: Path) -> None:
    assert merged.name == "lupin-0.1.0-py3-none-any.whl"
    with WheelFile(merged) as wheel:
        names = wheel.namelist()
        for name in names:
            wheel.read(name)  # raises if it differs from RECORD
    info = "lupin-0.1.0.dist-info"
    assert sorted(names) == [
        "lupin-0.1.0.data/data/share/lupin/a.txt",
        "lupin-0.1.0.data/data/share/lupin_msgs/b.msg",
        *(f"{info}/{name}" for name in ("METADATA", "RECORD", "WHEEL", "entry_points.txt")),
        "lupin_cli/__init__.py",
        "lupin_msgs/__init__.py",
    ]


def test_merged_wheel_pins_ros_and_requires_no_interfaces(merged: Path) -> None:
    with WheelFile(merged) as wheel:
        metadata = message_from_bytes(wheel.read("lupin-0.1.0.dist-info/METADATA"))
    assert metadata["Name"] == "lupin"
    assert metadata.get_all("Requires-Dist") == ["typer>=0.28", *(f"{pin}; platform_machine == 'x86_64'" for pin in PINS)]


def test_merged_wheel_is_installed_by_pip(merged: Path, tmp_path: Path) -> None:
    target = tmp_path / "site"
    command = [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-deps", "--no-index"]
    subprocess.run([*command, "--target", str(target), str(merged)], check=True, timeout=60)
    assert (target / "lupin_msgs/__init__.py").read_text() == "NAME = 'msgs'\n"
    assert (target / "share/lupin_msgs/b.msg").read_text() == "b\n"


def test_wheel_of_an_earlier_build_is_replaced(merged: Path) -> None:
    folder = merged.parent
    lupin = write_wheel(folder.parent, "lupin", {"lupin_cli/new.py": ""}, ("typer",))
    again = merge(lupin, folder.parent / "lupin_interfaces-0.1.0-py3-none-any.whl", folder, [])
    with WheelFile(again) as wheel:
        assert again == merged and "lupin_cli/new.py" in wheel.namelist() and "lupin_cli/__init__.py" not in wheel.namelist()


def test_each_package_of_the_lock_is_pinned_once(tmp_path: Path) -> None:
    lock = tmp_path / "requirements.lock"
    lock.write_text("numpy==2.0 \\\n    --hash=sha256:0\nros-a==7.1.6 \\\n    --hash=sha256:1\n# ros-x==1\n")
    assert locked_pins(lock) == ["numpy==2.0", "ros-a==7.1.6"]
