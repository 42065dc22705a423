"""lupin.toml: which robots there are and how each is reached.

default_robot = "greenhouse"

[robots.greenhouse]
user = "mirte"                       # mirte where nothing is said
ros_setup = ["source /opt/ros/humble/setup.bash", "source ~/mirte_ws/install/setup.bash"]

[robots.greenhouse.addresses]        # tried in the order of their rank: wired, router, ap
wired = "10.42.0.1"
ap = "192.168.42.1"
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

from lupin_cli.quick_dataclass import dataclass

TRANSPORTS = ("wired", "router", "ap")  # best first
DEFAULT_USER = "mirte"
ROS_SETUP = ("source /opt/ros/humble/setup.bash", "source ~/mirte_ws/install/setup.bash")
_NAME = re.compile(r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")


class ConfigError(Exception):
    """What is wrong in which line of which file, and what was probably meant."""


@dataclass(frozen=True)
class Robot:
    """A robot of the inventory. `addresses` maps transports to `host` or `host:port`, best transport first."""

    name: str
    addresses: Mapping[str, str]
    user: str = ""  # empty: what ~/.ssh/config says, else mirte
    transport: str = ""  # the one to use, where only one is wanted
    ros_setup: tuple[str, ...] = ROS_SETUP


@dataclass(frozen=True)
class Config:
    """The whole file; an absent one is an empty one."""

    path: Path
    robots: Mapping[str, Robot] = field(default_factory=dict)
    default_robot: str = ""

    @property
    def known_hosts(self) -> Path:
        """Lupin's own accepted host keys lie beside the inventory."""
        return self.path.with_name("known_hosts")


def config_directory(environment: Mapping[str, str] | None = None) -> Path:
    """`${XDG_CONFIG_HOME:-~/.config}/lupin`."""
    environment = os.environ if environment is None else environment
    home = Path(environment.get("HOME") or Path.home())
    return Path(environment.get("XDG_CONFIG_HOME") or home / ".config") / "lupin"


def load(path: Path | None = None) -> Config:
    """The inventory from `path`, $LUPIN_CONFIG or the user's own. Raises ConfigError.

    A file that was named must be there; the user's own need not.
    """
    named = path or (Path(os.environ["LUPIN_CONFIG"]) if os.environ.get("LUPIN_CONFIG") else None)
    place = named or config_directory() / "lupin.toml"
    try:
        text = place.read_text(encoding="utf-8")
    except FileNotFoundError:
        if named is not None:
            raise ConfigError(f"{place}: no such file; make one with: lupin robots add NAME ADDRESS --config {place}") from None
        return Config(place)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{place}: can't be read: {error}") from error
    return parse(text, place)


def parse(text: str, path: Path) -> Config:
    """The inventory that `text` spells. Raises ConfigError with file, line and the nearest valid word."""
    import tomllib

    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        line = re.search(r"line (\d+)", str(error))
        raise ConfigError(f"{path}:{line[1] if line else 1}: this is no TOML: {error}") from error
    reader = _Reader(text, path)
    reader.table((), raw, _TOP)
    robots = {name: reader.robot(name, entry) for name, entry in raw.get("robots", {}).items()}
    default = raw.get("default_robot", "")
    if default and default not in robots:
        reader.fail(("default_robot",), f"there is no robot {default!r}{_nearest(default, robots)}")
    return Config(path, robots, default)


def _is_text(value: Any) -> str:
    return "" if isinstance(value, str) and value.strip() else "a text in quotes"


def _is_table(value: Any) -> str:
    return "" if isinstance(value, dict) else "a table"


def _is_lines(value: Any) -> str:
    fine = isinstance(value, list) and all(isinstance(line, str) and "\n" not in line for line in value)
    return "" if fine else 'a list of lines in quotes, ["..."]'


def _is_address(value: Any) -> str:
    from lupin_cli.target.destination import parse_destination

    if isinstance(value, str):
        try:
            return "an address without a user; the user stands above" if parse_destination(value)[0] else ""
        except ValueError:
            pass
    return 'an address in quotes, "10.42.0.1" or "name:22"'


def _is_transport(value: Any) -> str:
    return "" if value in TRANSPORTS else f"one of {', '.join(TRANSPORTS)}{_nearest(str(value), TRANSPORTS)}"


# What may stand where: a word, and what is wrong with a value (empty: nothing).
Rules = Mapping[str, Callable[[Any], str]]
_TOP: Rules = {"default_robot": _is_text, "robots": _is_table}
_ROBOT: Rules = {
    "user": _is_text,
    "addresses": _is_table,
    "transport": _is_transport,
    "ros_setup": _is_lines,
}
_ADDRESSES: Rules = dict.fromkeys(TRANSPORTS, _is_address)


class _Reader:
    def __init__(self, text: str, path: Path) -> None:
        self._lines, self._path = text.splitlines(), path

    def fail(self, place: tuple[str, ...], problem: str) -> None:
        raise ConfigError(f"{self._path}:{line_of(self._lines, place)}: {problem}")

    def table(self, place: tuple[str, ...], entry: Any, rules: Rules) -> None:
        """Hold a table against its rules."""
        if not isinstance(entry, dict):
            self.fail(place, f"{'.'.join(place)} must be a table")
        for word, value in entry.items():
            here = (*place, word)
            if word not in rules:
                known = f"it knows {', '.join(rules)}"
                self.fail(
                    here, f"{word!r} means nothing in {'.'.join(place) or 'this file'}{_nearest(word, rules) or '; ' + known}"
                )
            wrong = rules[word](value)
            if wrong:
                self.fail(here, f"{'.'.join(here)} must be {wrong}; it is {value!r}")

    def robot(self, name: str, entry: Any) -> Robot:
        """One robot of the inventory."""
        place = ("robots", name)
        if not _NAME.match(name):
            self.fail(place, f"{name!r} is no name for a robot: letters, digits, dots, dashes and underscores")
        self.table(place, entry, _ROBOT)
        addresses = entry.get("addresses", {})
        self.table((*place, "addresses"), addresses, _ADDRESSES)
        if not addresses:
            self.fail(place, f'{name} has no address; say: [robots.{name}.addresses] and wired = "10.42.0.1"')
        transport = entry.get("transport", "")
        if transport and transport not in addresses:
            self.fail((*place, "transport"), f"{name} has no address for the transport {transport}")
        return Robot(
            name,
            {kind: addresses[kind] for kind in TRANSPORTS if kind in addresses},
            entry.get("user", ""),
            transport,
            tuple(entry.get("ros_setup", ROS_SETUP)),
        )


def _nearest(word: str, known: Any) -> str:
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


_HEADER = re.compile(r"^\s*\[\[?\s*(.+?)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"""^\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*=""")


def line_of(lines: list[str], place: tuple[str, ...]) -> int:
    """The line, from 1, where the table or value at `place` is written: tomllib doesn't tell.

    A value within an inline table has the line of the innermost table that has one of its own.
    """
    best, best_line = 0, 1
    header: tuple[str, ...] = ()
    for number, line in enumerate(lines, 1):
        found = _HEADER.match(line)
        if found:
            header = here = _words(found[1])
        else:
            found = _KEY.match(line)
            if not found:
                continue
            here = (*header, *_words(found[1]))
        common = min(len(here), len(place))
        if common > best and here[:common] == place[:common]:
            best, best_line = common, number
    return best_line


def _words(dotted: str) -> tuple[str, ...]:
    return tuple(word.strip("\"'") for word in re.findall(r"""[A-Za-z0-9_-]+|"[^"]*"|'[^']*'""", dotted))


# -- the inventory as text: comments and order are the user's, so a robot is appended or cut out, and nothing else is touched


def with_robot(text: str, robot: Robot) -> str:
    """`text` with `robot` added at its end."""
    lines = [f"[robots.{_quoted_key(robot.name)}]"]
    if robot.user:
        lines.append(f"user = {_quoted(robot.user)}")
    if robot.ros_setup != ROS_SETUP:
        lines.append(f"ros_setup = [{', '.join(_quoted(line) for line in robot.ros_setup)}]")
    lines += ["", f"[robots.{_quoted_key(robot.name)}.addresses]"]
    lines += [f"{transport} = {_quoted(address)}" for transport, address in robot.addresses.items()]
    return f"{text.rstrip()}\n\n".lstrip() + "\n".join(lines) + "\n"


def without_robot(text: str, name: str) -> str:
    """`text` without the tables of the robot `name`."""
    kept, cutting = [], False
    for line in text.splitlines(keepends=True):
        found = _HEADER.match(line)
        if found:
            cutting = _words(found[1])[:2] == ("robots", name)
        if not cutting and not (re.match(r"^\s*default_robot\s*=", line) and f'"{name}"' in line):
            kept.append(line)
    return "".join(kept)


def _quoted_key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _quoted(name)


def _quoted(text: str) -> str:
    import json

    return json.dumps(text, ensure_ascii=False)
