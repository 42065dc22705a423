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
    if robot.ros_setup != ROS_SETUP:
        lines.append(f"ros_setup = [{', '.join(_quoted(line) for line in robot.ros_setup)}]")
    lines += ["", f"[robots.{_quoted_key(robot.name)}.addresses]"]
    lines += [f"{transport} = {_quoted(address)}" for transport, address in robot.addresses.items()]
    return f"{text.rstrip()}\n\n".lstrip() + "\n".join(lines) + "\n"


def without_robot(text: str, name: str) -> str:
    """Return `text` without the tables of the robot `name`."""
    kept, skipping = [], False
    for line in text.splitlines(keepends=True):
        found = TABLE_HEADER.match(line)
        if found:
            skipping = split_key(found[1])[:2] == ("robots", name)
        if not skipping and not (re.match(r"^\s*default_robot\s*=", line) and f'"{name}"' in line):
            kept.append(line)
    return "".join(kept)


def _quoted_key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _quoted(name)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
