"""Reads chrony's configuration as chronyd does: only the files that it reads, in its order.

chrony.conf(5): directives are not case-sensitive; a line that begins with ! ; # or % is a comment. `include` takes a pattern.
`confdir` takes folders, whose *.conf files are read in the order of their names; of two with one name, that in the first folder
counts. `sourcedir` does the same with *.sources, in which only server, pool and peer count. Files are nested up to ten deep.
"""

from __future__ import annotations

import re

# chrony_main prints the main file: that of the running chronyd, or Debian's, or the upstream default.
# chrony_lines REGEX prints FILE:NUMBER:LINE for each directive that the extended regular expression matches.
READER = r"""
chrony_main() {
  pid=$(pidof -s chronyd)
  file=$([ -z "$pid" ] || tr '\0' '\n' <"/proc/$pid/cmdline" 2>/dev/null | sed -n '/^-f$/{n;p;q;}; s/^-f//p' | head -n 1)
  for each in "$file" /etc/chrony/chrony.conf /etc/chrony.conf; do
    [ ! -f "$each" ] || { printf '%s\n' "$each"; return; }
  done
}
chrony_read() ( # FILE LEVEL ONLY_SOURCES
  file=$1 level=$2 only=$3 number=0 blank=$(printf ' \t\r\v\f')
  [ "$level" -le 10 ] && [ -f "$file" ] && [ -r "$file" ] || exit 0
  while IFS= read -r line || [ -n "$line" ]; do
    number=$((number + 1)) IFS=$blank
    set -f
    set -- $line
    set +f
    IFS=
    case ${1-} in '' | '!'* | ';'* | '#'* | '%'*) continue ;; esac
    printf '%s:%s:%s\n' "$file" "$number" "$line"
    [ -z "$only" ] || continue
    case $1 in
    [Ii][Nn][Cc][Ll][Uu][Dd][Ee]) for each in ${2-}; do chrony_read "$each" $((level + 1)) ''; done ;;
    [Cc][Oo][Nn][Ff][Dd][Ii][Rr]) shift && chrony_folders .conf '' $((level + 1)) "$@" ;;
    [Ss][Oo][Uu][Rr][Cc][Ee][Dd][Ii][Rr]) shift && chrony_folders .sources only $((level + 1)) "$@" ;;
    esac
  done <"$file" | if [ -z "$only" ]; then cat; else grep -iE ':[0-9]+:[[:space:]]*(server|pool|peer)[[:space:]]'; fi
)
chrony_folders() ( # SUFFIX ONLY_SOURCES LEVEL FOLDER...
  suffix=$1 only=$2 level=$3 IFS=
  shift 3
  for folder; do
    for each in "${folder%/}"/*"$suffix"; do [ ! -e "$each" ] || printf '%s\n' "${each##*/}"; done
  done | LC_ALL=C sort -u | while IFS= read -r name; do
    for folder; do
      [ ! -e "${folder%/}/$name" ] || { chrony_read "${folder%/}/$name" "$level" "$only"; break; }
    done
  done
)
chrony_lines() {
  main=$(chrony_main)
  [ -z "$main" ] || LC_ALL=C chrony_read "$main" 1 '' | grep -iE ":[0-9]+:[[:space:]]*($1)([[:space:]]|\$)"
}
"""

_LINE = re.compile(r"(?P<file>.+?):(?P<number>\d+):(?P<text>.*)", re.DOTALL)


def parse_line(line: str) -> tuple[str, list[str]]:
    """Return the file of a line of `chrony_lines`, and the words of its directive, the first in lower case."""
    match = _LINE.match(line)
    words = match["text"].split() if match else []
    return (match["file"] if match else ""), [words[0].lower(), *words[1:]] if words else []


def comment_out(text: str, directive: str) -> str:
    """Return a configuration in which the lines of a directive, in lower case, are comments."""
    lines = text.split("\n")
    return "\n".join(f"# {line}" if line.split()[:1] and line.split()[0].lower() == directive else line for line in lines)
