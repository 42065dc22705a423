"""Versions of operating system, Python, ROS and Fast DDS, and the deployed release of Lupin with its folders."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, Sections, parse_sections
from lupin_cli.release.paths import ROOT
from lupin_runtime.json_text import parse_json

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
for f in {ROOT}/current/venv/lib/python3*/site-packages/lupin_runtime/cameras/service.py; do
  [ -e "$f" ] && echo '@@ cameras'
done
echo '@@ release.json'; cat {ROOT}/current/release.json 2>/dev/null
echo '@@ end'
"""
)


@dataclass(frozen=True)
class Release:
    """The deployed release and the folders of the other releases."""

    current: str  # its ID; empty if there is none
    complete: bool  # the folder that `current` points to exists
    previous: str
    releases: tuple[str, ...]
    incoming: tuple[str, ...]
    version: str  # of Lupin
    python: tuple[int, ...]  # version that it was built for
    cameras: bool = False  # it has the camera service


@dataclass(frozen=True)
class Versions:
    """The versions on a machine. `release` is None if Lupin was never deployed to it."""

    system: str
    machine: str
    python: tuple[int, ...]  # empty without python3
    ros: tuple[str, ...]  # distributions below /opt/ros
    fast_dds: tuple[str, ...]  # versions of the libraries found
    fast_dds_files: tuple[str, ...]
    release: Release | None


def parse(output: Output) -> Versions:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    files = sections.lines("fast-dds")
    found = re.search(r"Python (\d+)\.(\d+)(?:\.(\d+))?", sections.text("python3"))
    return Versions(
        system=sections.text("os"),
        machine=sections.text("machine"),
        python=tuple(int(digits) for digits in found.groups() if digits) if found else (),
        ros=sections.lines("ros"),
        fast_dds=tuple(dict.fromkeys(_version(path) for path in files if _version(path))),
        fast_dds_files=files,
        release=_release(sections) if sections.lines("root") else None,
    )


def _version(path: str) -> str:
    # Libraries from wheels have a hash in their name: libfastrtps-1a2b3c4d.so.2.14.5
    found = re.search(r"\.so\.(\d+\.\d+\.\d+)$", path)
    return found[1] if found else ""


def _release(sections: Sections) -> Release:
    try:
        description = parse_json("\n".join(sections.lines("release.json")) or "{}")
        version, python = str(description.get("version", "")), tuple(int(part) for part in description.get("python", ()))
    except (ValueError, AttributeError, TypeError):
        version, python = "", ()
    return Release(
        current=sections.text("current").rstrip("/").rpartition("/")[2],
        complete=sections.text("reachable") == "yes",
        previous=sections.text("previous").rstrip("/").rpartition("/")[2],
        releases=sections.lines("releases"),
        incoming=sections.lines("incoming"),
        version=version,
        python=python,
        cameras=sections.get("cameras") is not None,
    )


VERSIONS = Fact("versions", PROBE, parse)
