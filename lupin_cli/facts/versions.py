"""What a machine runs: operating system, Python, ROS, Fast DDS, and which release of Lupin, with how its folders lie."""

from __future__ import annotations

import json
import re

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, Answers, answers
from lupin_cli.onboard import ROOT
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

PROBE = (
    PRELUDE
    + f"""echo '@@ os'; sed -n 's/^PRETTY_NAME=//p' /etc/os-release 2>/dev/null | tr -d '"'
echo '@@ machine'; uname -m
echo '@@ python3'; command -v python3 >/dev/null 2>&1 && python3 --version 2>&1
echo '@@ ros'; ls /opt/ros 2>/dev/null
echo '@@ fast-dds'
for d in /opt/ros/*/lib /opt/ros/*/lib/*-linux-gnu {ROOT}/current/venv/lib/python3*/site-packages/ros_fastrtps.libs \\
  /usr/lib/*-linux-gnu /usr/local/lib; do
  for l in "$d"/libfastrtps*.so.*.*.* "$d"/libfastdds*.so.*.*.*; do [ -e "$l" ] && [ ! -L "$l" ] && echo "$l"; done
done
echo '@@ root'; [ -d {ROOT} ] && stat -c '%U:%G %a %n' {ROOT}
echo '@@ current'; readlink {ROOT}/current
echo '@@ previous'; readlink {ROOT}/previous
echo '@@ releases'; ls {ROOT}/releases 2>/dev/null
echo '@@ incoming'; ls -A {ROOT}/incoming 2>/dev/null
echo '@@ reachable'; [ -e {ROOT}/current/ ] && echo yes
echo '@@ release.json'; cat {ROOT}/current/release.json 2>/dev/null
echo '@@ end'
"""
)


@dataclass(frozen=True)
class Release:
    """The release that a robot runs from, and the folders around it."""

    current: str  # id; empty where none is
    complete: bool  # what `current` points at is there
    previous: str
    releases: tuple[str, ...]
    incoming: tuple[str, ...]
    version: str  # of Lupin in it
    python: tuple[int, ...]  # it was built for


@dataclass(frozen=True)
class Versions:
    """What runs here. `release` is None where nothing was ever deployed."""

    system: str
    machine: str
    python: tuple[int, ...]  # empty: no python3
    ros: tuple[str, ...]  # distributions below /opt/ros
    fast_dds: tuple[str, ...]  # versions of the libraries found
    fast_dds_files: tuple[str, ...]
    release: Release | None


def parse(output: Output) -> Versions:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    said.lines("end")
    files = said.lines("fast-dds")
    found = re.search(r"Python (\d+)\.(\d+)(?:\.(\d+))?", said.text("python3"))
    return Versions(
        system=said.text("os"),
        machine=said.text("machine"),
        python=tuple(int(digits) for digits in found.groups() if digits) if found else (),
        ros=said.lines("ros"),
        fast_dds=tuple(dict.fromkeys(_version(path) for path in files if _version(path))),
        fast_dds_files=files,
        release=_release(said) if said.lines("root") else None,
    )


def _version(path: str) -> str:
    # Wheels put a hash into the name: libfastrtps-1a2b3c4d.so.2.14.5
    found = re.search(r"\.so\.(\d+\.\d+\.\d+)$", path)
    return found[1] if found else ""


def _release(said: Answers) -> Release:
    try:
        description = json.loads("\n".join(said.lines("release.json")) or "{}")
        version, python = str(description.get("version", "")), tuple(int(part) for part in description.get("python", ()))
    except (ValueError, AttributeError, TypeError):
        version, python = "", ()
    return Release(
        current=said.text("current").rstrip("/").rpartition("/")[2],
        complete=said.text("reachable") == "yes",
        previous=said.text("previous").rstrip("/").rpartition("/")[2],
        releases=said.lines("releases"),
        incoming=said.lines("incoming"),
        version=version,
        python=python,
    )


VERSIONS = Fact("versions", PROBE, parse)
