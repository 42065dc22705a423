"""How probes of several questions separate their answers: a line `@@ name argument` opens a section."""

from __future__ import annotations

import shlex

from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

MARK = "@@ "
# A shell without a login finds no /usr/sbin on Debian, and messages are only known in the C locale.
PRELUDE = 'LC_ALL=C; export LC_ALL; PATH="$PATH:/usr/sbin:/sbin"\n'


def as_root_if_allowed(script: str) -> str:
    """sh that runs `script` as root where sudo wants no password, else as the user. It goes to a shell of its own, once: every
    sudo is a session of its own to set up. What it says on standard error goes nowhere, since sudo's refusal does."""
    text = shlex.quote(f"{PRELUDE}{script}\nexit 0")
    return f'as_root={text}\n{{ [ "$(id -u)" != 0 ] && sudo -n sh -c "$as_root" || sh -c "$as_root"; }} 2>/dev/null\n'


@dataclass(frozen=True)
class Section:
    """One answer: what was asked, about what, and the lines."""

    name: str
    argument: str
    lines: tuple[str, ...]

    @property
    def text(self) -> str:
        """The first line without surrounding space; empty where there is none."""
        return self.lines[0].strip() if self.lines else ""


@dataclass(frozen=True)
class Answers:
    """The sections of one output, in their order."""

    sections: tuple[Section, ...]

    def every(self, name: str) -> tuple[Section, ...]:
        """All sections of that name."""
        return tuple(section for section in self.sections if section.name == name)

    def maybe(self, name: str) -> Section | None:
        """The first section of that name, or None."""
        return next(iter(self.every(name)), None)

    def lines(self, name: str) -> tuple[str, ...]:
        """The lines of the first section of that name that aren't blank. Raises ValueError where the probe never got there."""
        section = self.maybe(name)
        if section is None:
            raise ValueError(f"expected a section {name!r}, found {[s.name for s in self.sections] or 'nothing'}")
        return tuple(line for line in section.lines if line.strip())

    def text(self, name: str) -> str:
        """The first line of a section that must be there; empty where it says nothing. Raises ValueError."""
        return next(iter(self.lines(name)), "").strip()

    def number(self, name: str) -> float:
        """The first word of a section as a finite number. Raises ValueError."""
        return number(self.text(name).split()[0] if self.text(name) else "", name)


def answers(output: Output) -> Answers:
    """Split an output at its marks. Raises ValueError where it has none."""
    found: list[tuple[str, str, list[str]]] = []
    for line in output.stdout.splitlines():
        if line.startswith(MARK):
            name, _, argument = line[len(MARK) :].partition(" ")
            found.append((name, argument.strip(), []))
        elif found:
            found[-1][2].append(line)
    if not found:
        raise ValueError(f"no answer in {output.stdout[:80]!r}; it said {output.stderr.strip()[:120]!r}")
    return Answers(tuple(Section(name, argument, tuple(lines)) for name, argument, lines in found))


def number(text: str, what: str) -> float:
    """A finite number. Raises ValueError that says what it should have been."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if value - value != 0.0:  # NaN and both infinities
        raise ValueError(f"expected a number for {what}, found {text!r}")
    return value


def integer(text: str, what: str) -> int:
    """A whole number. Raises ValueError that says what it should have been."""
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"expected a whole number for {what}, found {text!r}") from None
