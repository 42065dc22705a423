"""lupin.toml, the inventory: the robots and how to reach each.

default_robot = "greenhouse"

[robots.greenhouse]
user = "mirte"                       # the default
ros_setup = ["source /opt/ros/humble/setup.bash", "source ~/mirte_ws/install/setup.bash"]
ssid = "Mirte-247264"                # of its access point, which `lupin deploy laptop` prefers

[robots.greenhouse.addresses]        # tried in the order wired, router, ap
wired = "10.42.0.1"
ap = "192.168.42.1"
"""

from __future__ import annotations

import difflib
import os
import re
import shlex
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from lupin_runtime.bounded_file import read_bounded_text

ADD_EXAMPLE = "lupin robots add greenhouse mirte@10.42.0.1"
TRANSPORTS = ("wired", "router", "ap")  # best first
DEFAULT_USER = "mirte"
ROS_SETUP = ("source /opt/ros/humble/setup.bash", "source ~/mirte_ws/install/setup.bash")
MAX_BYTES = 256 * 1024
MAX_KEY_DOTS = 20  # of a key or the name of a table: the time for reading one grows with their square
_NAME = re.compile(r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")


class ConfigError(Exception):
    """A file or an option cannot be used. The message names file and line, and the nearest valid word."""

    def __init__(self, message: str, next_command: str = "") -> None:
        super().__init__(message)
        self.next_command = next_command


@dataclass(frozen=True)
class Robot:
    """A robot of the inventory. `addresses` maps transports to `host` or `host:port`, best transport first."""

    name: str
    addresses: Mapping[str, str]
    user: str = ""  # empty: from ~/.ssh/config, else mirte
    transport: str = ""  # use only this one
    ros_setup: tuple[str, ...] = ROS_SETUP
    ssid: str = ""  # of its access point; empty: not known


@dataclass(frozen=True)
class Config:
    """The content of lupin.toml; an absent file is an empty inventory."""

    path: Path
    robots: Mapping[str, Robot] = field(default_factory=dict)
    default_robot: str = ""

    @property
    def known_hosts(self) -> Path:
        """The file of host keys that Lupin has accepted, beside the inventory."""
        return self.path.with_name("known_hosts")


def config_directory(environment: Mapping[str, str] | None = None) -> Path:
    """Return `${XDG_CONFIG_HOME:-~/.config}/lupin`."""
    environment = os.environ if environment is None else environment
    home = Path(environment.get("HOME") or Path.home())
    return Path(environment.get("XDG_CONFIG_HOME") or home / ".config") / "lupin"


def load(path: Path | None = None) -> Config:
    """Read the inventory from `path`, else from $LUPIN_CONFIG, else from the user's configuration directory.

    Raises ConfigError. A file named by `path` or $LUPIN_CONFIG must exist; the one in the configuration directory need not.
    """
    named = path or (Path(os.environ["LUPIN_CONFIG"]) if os.environ.get("LUPIN_CONFIG") else None)
    found = named or config_directory() / "lupin.toml"
    try:
        text = read_bounded_text(found, MAX_BYTES)
    except FileNotFoundError:
        if named is not None:
            raise ConfigError(f"{found}: no such file", f"{ADD_EXAMPLE} --config {shlex.quote(str(found))}") from None
        return Config(found)
    except OSError as error:
        raise ConfigError(f"{found}: cannot be read: {error.strerror or error}") from error
    return parse(text, found)


def parse(text: str, path: Path) -> Config:
    """Parse the text of an inventory. Raises ConfigError with file, line and the nearest valid word."""
    import tomllib

    for number, row in enumerate(text.splitlines(), 1):
        if row.partition("=")[0].count(".") > MAX_KEY_DOTS:
            raise ConfigError(f"{path}:{number}: a key has more than {MAX_KEY_DOTS} dots")
    try:
        raw = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:  # too deep; a number of thousands of digits
        line = re.search(r"line (\d+)", str(error))
        raise ConfigError(f"{path}:{line[1] if line else 1}: not valid TOML: {error}") from error
    validator = _Validator(text, path)
    validator.check_table((), raw, _TOP)
    robots = {name: validator.robot(name, table) for name, table in raw.get("robots", {}).items()}
    default = raw.get("default_robot", "")
    if default and default not in robots:
        validator.fail(("default_robot",), f"there is no robot {default!r}{_nearest(default, robots)}")
    return Config(path, robots, default)


def _expect_text(value: object) -> str:
    return "" if isinstance(value, str) and value.strip() else "a string in quotes"


def _expect_table(value: object) -> str:
    return "" if isinstance(value, dict) else "a table"


def _expect_lines(value: object) -> str:
    is_valid = isinstance(value, list) and all(isinstance(line, str) and "\n" not in line for line in value)
    return "" if is_valid else 'a list of lines in quotes, ["..."]'


def _expect_address(value: object) -> str:
    from lupin_cli.connection.destination import parse_destination

    if isinstance(value, str):
        try:
            return "an address without a user; write the user as user = ..." if parse_destination(value)[0] else ""
        except ValueError:
            pass
    return 'an address in quotes, "10.42.0.1" or "name:22"'


def _expect_transport(value: object) -> str:
    return "" if value in TRANSPORTS else f"one of {', '.join(TRANSPORTS)}{_nearest(str(value), TRANSPORTS)}"


# The keys of a table, each with a function that returns what its value must be, or an empty string if the value is right.
Rules = Mapping[str, Callable[[object], str]]
_TOP: Rules = {"default_robot": _expect_text, "robots": _expect_table}
_ROBOT: Rules = {
    "user": _expect_text,
    "addresses": _expect_table,
    "transport": _expect_transport,
    "ros_setup": _expect_lines,
    "ssid": _expect_text,
}
_ADDRESSES: Rules = dict.fromkeys(TRANSPORTS, _expect_address)


class _Validator:
    """Checks the tables of an inventory; errors name the line. `key` is the path of a table or value: ("robots", "pot-1")."""

    def __init__(self, text: str, path: Path) -> None:
        self._lines, self._path = text.splitlines(), path

    def fail(self, key: tuple[str, ...], problem: str) -> NoReturn:
        raise ConfigError(f"{self._path}:{line_of(self._lines, key)}: {problem}")

    def check_table(self, key: tuple[str, ...], table: object, rules: Rules) -> None:
        """Raise ConfigError unless `table` is one and all of its keys and values obey the rules."""
        if not isinstance(table, dict):
            self.fail(key, f"{'.'.join(key)} must be a table")
        for name, value in table.items():
            child = (*key, name)
            if name not in rules:
                hint = _nearest(name, rules) or f"; the keys are {', '.join(rules)}"
                self.fail(child, f"unknown key {name!r} in {'.'.join(key) or 'this file'}{hint}")
            if expected := rules[name](value):
                self.fail(child, f"{'.'.join(child)} must be {expected}; it is {value!r}")

    def robot(self, name: str, table: Any) -> Robot:
        """Return the robot of the table `[robots.NAME]`."""
        key = ("robots", name)
        if not _NAME.match(name):
            self.fail(key, f"{name!r} is not a robot's name; use letters, digits, dots, dashes and underscores")
        self.check_table(key, table, _ROBOT)
        addresses = table.get("addresses", {})
        self.check_table((*key, "addresses"), addresses, _ADDRESSES)
        if not addresses:
            self.fail(key, f'{name} has no address; add: [robots.{name}.addresses] and wired = "10.42.0.1"')
        transport = table.get("transport", "")
        if transport and transport not in addresses:
            self.fail((*key, "transport"), f"{name} has no address for the transport {transport}")
        return Robot(
            name,
            {kind: addresses[kind] for kind in TRANSPORTS if kind in addresses},
            table.get("user", ""),
            transport,
            tuple(table.get("ros_setup", ROS_SETUP)),
            table.get("ssid", ""),
        )


def _nearest(word: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


TABLE_HEADER = re.compile(r"^\s*\[\[?\s*(.+?)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"""^\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*=""")


def line_of(lines: list[str], key: tuple[str, ...]) -> int:
    """Return the line, counted from 1, of the table or value `key`; tomllib does not keep it.

    A value inside an inline table has the line of the innermost table that starts a line.
    """
    best, best_line = 0, 1
    header: tuple[str, ...] = ()
    for number, line in enumerate(lines, 1):
        found = TABLE_HEADER.match(line)
        if found:
            header = path = split_key(found[1])
        else:
            found = _KEY.match(line)
            if not found:
                continue
            path = (*header, *split_key(found[1]))
        common = min(len(path), len(key))
        if common > best and path[:common] == key[:common]:
            best, best_line = common, number
    return best_line


def split_key(dotted: str) -> tuple[str, ...]:
    """Split a dotted key of TOML into its parts, without their quotes."""
    return tuple(word.strip("\"'") for word in re.findall(r"""[A-Za-z0-9_-]+|"[^"]*"|'[^']*'""", dotted))
