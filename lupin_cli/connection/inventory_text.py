"""Edit the text of lupin.toml. Comments and order are the user's: a robot is appended or removed, and nothing else changes."""

from __future__ import annotations

import json
import re

from lupin_cli.connection.inventory import ROS_SETUP, TABLE_HEADER, Robot, split_key


def with_robot(text: str, robot: Robot) -> str:
    """Return `text` with `robot` appended."""
    lines = [f"[robots.{_quoted_key(robot.name)}]"]
    if robot.user:
        lines.append(f"user = {_quoted(robot.user)}")
    if robot.transport:
        lines.append(f"transport = {_quoted(robot.transport)}")
    if robot.ros_setup != ROS_SETUP:
        lines.append(f"ros_setup = [{', '.join(_quoted(line) for line in robot.ros_setup)}]")
    if robot.ssid:
        lines.append(f"ssid = {_quoted(robot.ssid)}")
    lines += ["", f"[robots.{_quoted_key(robot.name)}.addresses]"]
    lines += [f"{transport} = {_quoted(address)}" for transport, address in robot.addresses.items()]
    return f"{text.rstrip()}\n\n".lstrip() + "\n".join(lines) + "\n"


def with_address(text: str, name: str, transport: str, address: str) -> str:
    """Return `text` with one more line in the table [robots.NAME.addresses], or unchanged if there is no such table."""
    lines = text.splitlines(keepends=True)
    for number, line in enumerate(lines):
        found = TABLE_HEADER.match(line)
        if found and split_key(found[1]) == ("robots", name, "addresses"):
            header = line if line.endswith("\n") else f"{line}\n"
            lines[number] = f"{header}{transport} = {_quoted(address)}\n"
            return "".join(lines)
    return text


def without_robot(text: str, name: str, *, keep_default: bool = False) -> str:
    """Return `text` without the tables of the robot `name` and, unless `keep_default`, without its place as the default."""
    kept, skipping = [], False
    for line in text.splitlines(keepends=True):
        found = TABLE_HEADER.match(line)
        if found:
            skipping = split_key(found[1])[:2] == ("robots", name)
        names_default = re.match(rf"""^\s*default_robot\s*=\s*["']{re.escape(name)}["']""", line) is not None
        if not skipping and (keep_default or not names_default):
            kept.append(line)
    return "".join(kept)


def with_renamed_robot(text: str, old: str, new: str) -> str:
    """Return `text` with another name for a robot, in its tables and as the default robot."""
    lines = []
    for line in text.splitlines(keepends=True):
        found = TABLE_HEADER.match(line)
        key = split_key(found[1]) if found else ()
        if found and key[:2] == ("robots", old):
            header = ".".join(["robots", *(_quoted_key(part) for part in (new, *key[2:]))])
            line = line[: found.start(1)] + header + line[found.end(1) :]
        elif re.match(r"^\s*default_robot\s*=", line):
            line = line.replace(_quoted(old), _quoted(new)).replace(f"'{old}'", _quoted(new))
        lines.append(line)
    return "".join(lines)


def _quoted_key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _quoted(name)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
