"""The output format of probes: sections, each started by a line `@@ name argument`."""

from __future__ import annotations

import shlex
from dataclasses import dataclass

from lupin_cli.connection.base import Output

MARK = "@@ "
# On Debian, a non-login shell has no /usr/sbin in its PATH. Parsers expect the messages of the C locale.
PRELUDE = 'LC_ALL=C; export LC_ALL; PATH="$PATH:/usr/sbin:/sbin"\n'


def as_root_if_allowed(script: str) -> str:
    """Return sh that runs `script` as root if sudo needs no password, otherwise as the user.

    The whole script runs in one call of sudo, since each call sets up a session. Standard error is discarded along with sudo's
    refusal.
    """
    text = shlex.quote(f"{PRELUDE}{script}\nexit 0")
    return f'as_root={text}\n{{ [ "$(id -u)" != 0 ] && sudo -n sh -c "$as_root" || sh -c "$as_root"; }} 2>/dev/null\n'


@dataclass(frozen=True)
class Section:
    """A section of a probe's output: its name, its argument, and its lines."""

    name: str
    argument: str
    lines: tuple[str, ...]

    @property
    def text(self) -> str:
        """The first line without surrounding space; empty if there is none."""
        return self.lines[0].strip() if self.lines else ""


@dataclass(frozen=True)
class Sections:
    """The sections of one output, in order."""

    sections: tuple[Section, ...]

    def all(self, name: str) -> tuple[Section, ...]:
        """Return all sections of that name."""
        return tuple(section for section in self.sections if section.name == name)

    def get(self, name: str) -> Section | None:
        """Return the first section of that name, or None."""
        return next(iter(self.all(name)), None)

    def lines(self, name: str) -> tuple[str, ...]:
        """Return the non-blank lines of the first section of that name. Raises ValueError if the section is missing."""
        section = self.get(name)
        if section is None:
            raise ValueError(f"expected a section {name!r}, found {[s.name for s in self.sections] or 'nothing'}")
        return tuple(line for line in section.lines if line.strip())

    def text(self, name: str) -> str:
        """Return the first non-blank line of a section; empty if it has none. Raises ValueError if the section is missing."""
        return next(iter(self.lines(name)), "").strip()

    def number(self, name: str) -> float:
        """Return the first word of a section as a finite number. Raises ValueError."""
        return number(self.text(name).split()[0] if self.text(name) else "", name)


def parse_sections(output: Output) -> Sections:
    """Split an output into its sections. Raises ValueError if it has none."""
    found: list[tuple[str, str, list[str]]] = []
    # Not splitlines(): a value may contain other separators, such as a carriage return, which an operator does not see.
    for line in output.stdout.split("\n"):
        if line.startswith(MARK):
            name, _, argument = line[len(MARK) :].partition(" ")
            found.append((name, argument.strip(), []))
        elif found:
            found[-1][2].append(line)
    if not found:
        raise ValueError(f"expected sections, found {output.stdout[:80]!r}; stderr: {output.stderr.strip()[:120]!r}")
    return Sections(tuple(Section(name, argument, tuple(lines)) for name, argument, lines in found))


def number(text: str, what: str) -> float:
    """Parse a finite number; `what` names it in the ValueError."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if value - value != 0.0:  # NaN and both infinities
        raise ValueError(f"expected a number for {what}, found {text!r}")
    return value


def integer(text: str, what: str) -> int:
    """Parse a whole number; `what` names it in the ValueError."""
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"expected a whole number for {what}, found {text!r}") from None
