"""What a shell of this user gets to know of the graph: its variables, Lupin's three exports, and what the start files source in
which order."""

from __future__ import annotations

import re
from collections.abc import Mapping

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, answers
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

# A vendor's hook that unsets the server lies in a package's folder of the workspace whose setup file is sourced.
PROBE = (
    PRELUDE
    + r"""echo "@@ home $HOME"; echo '@@ environment'; env | grep -E '^(ROS_|RMW_|FASTRTPS_|FASTDDS_)'
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

_EXPORT = re.compile(r"^\s*export\s+([A-Za-z_][A-Za-z0-9_]*)=(.*?)\s*$")


@dataclass(frozen=True)
class StartFile:
    """A shell's start file: its lines that matter, numbered as grep does, and the sourced files that wipe the server."""

    path: str
    lines: tuple[str, ...]
    wipes: Mapping[str, str]  # a sourced setup file → the hook of it that unsets the server


@dataclass(frozen=True)
class Shell:
    """The environment of the shell that asks, and what new ones will get."""

    environment: Mapping[str, str]
    exports_path: str  # where ros-env.sh is or would be
    exports: Mapping[str, str]  # what it exports; empty where it isn't there
    home: str = ""
    start_files: tuple[StartFile, ...] = ()

    @property
    def server(self) -> str:
        """The discovery server of the shell that asks."""
        return self.environment.get("ROS_DISCOVERY_SERVER", "").strip()


def parse(output: Output) -> Shell:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    environment = dict(line.split("=", 1) for line in said.lines("environment") if "=" in line)
    exports = said.maybe("exports")
    if exports is None:
        raise ValueError("expected a section 'exports'")
    found = {match[1]: match[2].strip("\"'") for line in exports.lines if (match := _EXPORT.match(line))}
    wipes = {section.argument: section.lines for section in said.every("wipes")}
    start_files = tuple(
        StartFile(
            section.argument,
            tuple(line for line in section.lines if line.strip()),
            dict(line.split(" ", 1) for line in wipes.get(section.argument, ()) if " " in line),
        )
        for section in said.every("start")
    )
    home = said.maybe("home")
    return Shell(environment, exports.argument, found, home.argument if home else "", start_files)


SHELL = Fact("shell", PROBE, parse)
