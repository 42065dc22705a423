"""The ROS environment of this user's shells: variables, exports of ros-env.sh, and what startup files source."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.ros_processes import domain_id
from lupin_cli.facts.sections import PRELUDE, parse_sections

# The vendor's hook that unsets ROS_DISCOVERY_SERVER is in a package of the workspace whose setup file is sourced.
PROBE = (
    PRELUDE
    + r"""echo "@@ home $HOME"; echo '@@ environment'
env | grep -E '^(ROS_|RMW_|FASTRTPS_|FASTDDS_|PYTHON(PATH|HOME)=|LD_(LIBRARY_PATH|PRELOAD)=)'
config="${XDG_CONFIG_HOME:-$HOME/.config}/lupin/ros-env.sh"
echo "@@ exports $config"; [ -r "$config" ] && { cat "$config"; echo; }
for start in .bashrc .zshrc; do
  [ -r "$HOME/$start" ] || continue
  echo "@@ start $HOME/$start"; grep -nE '^[^#]*(ros-env\.sh|setup\.(ba|z)?sh|mirte)' "$HOME/$start"
  echo "@@ wipes $HOME/$start"
  sed -nE "s#^[^\#]*(source|\.) +[\"']?([^\"' ;&]+setup\.(ba|z)?sh).*#\2#p" "$HOME/$start" |
    while read -r sourced; do
      file=$(printf '%s' "$sourced" | sed "s#^~#$HOME#; s#^\\\$HOME#$HOME#; s#^\\\${HOME}#$HOME#")
      for hook in $(grep -lsE 'unset +ROS_DISCOVERY_SERVER|ROS_DISCOVERY_SERVER= *$' "$file" \
        "${file%/*}"/share/*/environment/*.sh "${file%/*}"/share/*/hook/*.sh "${file%/*}"/*/share/*/environment/*.sh \
        "${file%/*}"/*/share/*/hook/*.sh); do echo "$sourced $hook"; done
    done
done
exit 0
"""
)

# A shell takes a carriage return at the end of the line for a part of the value.
_EXPORT = re.compile(r"^\s*export\s+([A-Za-z_][A-Za-z0-9_]*)=(.*?)[ \t]*(\r?)$")


@dataclass(frozen=True)
class StartupFile:
    """A shell's startup file: its relevant lines with line numbers, and the sourced files that unset ROS_DISCOVERY_SERVER."""

    path: str
    lines: tuple[str, ...]
    wipes: Mapping[str, str]  # hook that unsets the variable, by the sourced setup file


@dataclass(frozen=True)
class Shell:
    """The environment of the probe's shell, and what new shells will get."""

    environment: Mapping[str, str]
    exports_path: str  # path of ros-env.sh, whether it exists or not
    exports: Mapping[str, str]  # variables that it exports; empty if it is missing
    home: str = ""
    start_files: tuple[StartupFile, ...] = ()

    @property
    def server(self) -> str:
        """The discovery server of the probe's shell."""
        return self.environment.get("ROS_DISCOVERY_SERVER", "").strip()

    @property
    def domain(self) -> int:
        """The DDS domain of the probe's shell; 0 if ROS_DOMAIN_ID is unset or not a number."""
        return domain_id(self.environment)


def parse(output: Output) -> Shell:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    environment = dict(line.split("=", 1) for line in sections.lines("environment") if "=" in line)
    exports = sections.get("exports")
    if exports is None:
        raise ValueError("expected a section 'exports'")
    found = {match[1]: match[2].strip("\"'") + match[3] for line in exports.lines if (match := _EXPORT.match(line))}
    wipes = {section.argument: section.lines for section in sections.all("wipes")}
    start_files = tuple(
        StartupFile(
            section.argument,
            tuple(line for line in section.lines if line.strip()),
            dict(line.split(" ", 1) for line in wipes.get(section.argument, ()) if " " in line),
        )
        for section in sections.all("start")
    )
    home = sections.get("home")
    return Shell(environment, exports.argument, found, home.argument if home else "", start_files)


SHELL = Fact("shell", PROBE, parse)
