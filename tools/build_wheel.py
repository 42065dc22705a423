"""Build the one wheel of Lupin: its packages, compiled kernels, playbooks, units and ROS 2 interfaces.

    python tools/build_wheel.py OUTPUT_FOLDER

In a checkout, the interfaces are a separate distribution (`interfaces/`), since colcon builds the same folders on a robot. They
are not on a package index, so this script copies the files of their wheel into Lupin's and drops the requirement. Every ros-*
requirement is pinned to its version in requirements.lock, since the index has versions for several ROS distributions.
`constraints.txt`, beside the wheel, names the versions of all packages that Lupin was tested with.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from email import message_from_string
from pathlib import Path
from zipfile import ZipFile

from wheel.wheelfile import WheelFile

ROOT = Path(__file__).resolve().parents[1]
INTERFACES = "lupin-interfaces"


def build(source: Path, folder: Path) -> Path:
    """Build the wheel of `source` into `folder` with this environment's packages, and return its path."""
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--disable-pip-version-check", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "-w", str(folder), str(source)], check=True)
    return next(folder.glob("*.whl"))


def locked_pins(lock_file: Path) -> list[str]:
    """Return a requirement for the exact version of each package in a lock file."""
    return re.findall(r"^[\w.-]+==\S+", lock_file.read_text(), flags=re.MULTILINE)


def merged_metadata(text: str, pins: list[str]) -> str:
    """Return Lupin's METADATA without the requirement for its interfaces, and with every ros-* requirement pinned."""
    message = message_from_string(text)
    requirements = message.get_all("Requires-Dist", [])
    del message["Requires-Dist"]
    for requirement in requirements:
        if not requirement.startswith((INTERFACES, "ros-")):
            message["Requires-Dist"] = requirement
    for pin in pins:
        message["Requires-Dist"] = f"{pin}; platform_machine == 'x86_64'"
    return message.as_string()


def merge(lupin: Path, interfaces: Path, output: Path, pins: list[str]) -> Path:
    """Write the files of both wheels into one wheel in `output`, named like Lupin's, and return its path."""
    output.mkdir(parents=True, exist_ok=True)
    merged = output / lupin.name
    merged.unlink(missing_ok=True)
    dist_info = "-".join(lupin.name.split("-")[:2])
    with ZipFile(lupin) as own, ZipFile(interfaces) as extra, WheelFile(merged, "w") as wheel:
        for info in own.infolist():
            if info.filename == f"{dist_info}.dist-info/METADATA":
                wheel.writestr(info.filename, merged_metadata(own.read(info).decode(), pins))
            elif not info.filename.endswith((".dist-info/RECORD", "/")):
                wheel.writestr(info, own.read(info))
        for info in extra.infolist():
            top, _, rest = info.filename.partition("/")
            if top.endswith(".data"):
                info.filename = f"{dist_info}.data/{rest}"
            if not top.endswith(".dist-info") and rest:
                wheel.writestr(info, extra.read(info))
    return merged


def main(output: Path) -> None:
    """Build both wheels in a temporary folder, merge them into one in `output` beside its constraints, and print its path."""
    pins = locked_pins(ROOT / "requirements.lock")
    with tempfile.TemporaryDirectory(prefix="lupin-wheel-") as scratch:
        lupin = build(ROOT, Path(scratch) / "lupin")
        interfaces = build(ROOT / "interfaces", Path(scratch) / "interfaces")
        print(merge(lupin, interfaces, output, [pin for pin in pins if pin.startswith("ros-")]))
    (output / "constraints.txt").write_text("\n".join(pins) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
