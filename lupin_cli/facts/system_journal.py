"""Lines of this boot's system journal that report problems: of Lupin's units, of the vendor's, and of the kernel."""

from __future__ import annotations

import time
from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, as_root_if_allowed, parse_sections
from lupin_cli.facts.units import VENDOR
from lupin_cli.systemd.units import LUPIN_UNITS

KEPT_LINES = 60
SEARCHED_LINES = 4000
# The output of these units' programs is journaled with one priority, so problems can only be found by keywords.
# `exit code -11` is how a launch reports a spawner that was killed by a step of the clock.
WORDS = (
    "error|fatal|exception|traceback|wasn.t able|not found|exit code|exited|failed|no such|timed out|"
    "died|killed|too quickly|disconnect|could ?n.t|refused|denied|missed pings|no ports available|probably stuck"
)
KERNEL_WORDS = (
    "out of memory|oom-kill|usb .*(disconnect|error|reset|not accepting|unable to enumerate)|cdc_acm|ttyACM|ttyUSB|"
    "under.?voltage|thermal|throttl|i/o error|ext4-fs error|remount.*read-only|mmc.*(error|timeout)"
)
_UNITS = " ".join(f"-u {unit}" for unit in (VENDOR, *LUPIN_UNITS))

# A user who is not in the group adm or systemd-journal sees only lines of their own processes.
_READ_JOURNAL = f"""j() {{ journalctl -b --no-pager -q -o short-unix -n {SEARCHED_LINES} "$@"; }}
echo "@@ reader $(id -un)"
echo '@@ units'
j {_UNITS} | grep -iE "{WORDS}" | tail -n {KEPT_LINES}
echo '@@ kernel'
j -k | grep -iE "{KERNEL_WORDS}" | tail -n {KEPT_LINES}
echo '@@ end'"""
PROBE = (
    PRELUDE
    + "if ! command -v journalctl >/dev/null 2>&1; then echo '@@ no-journal'; exit 0; fi\n"
    + as_root_if_allowed(_READ_JOURNAL)
)


@dataclass(frozen=True)
class JournalLine:
    """One line. `time_s` is the machine's wall clock when it was written, and wrong for lines before a step of the clock."""

    time_s: float
    source: str  # the syslog identifier with its PID, or `kernel`
    text: str
    raw: str

    @property
    def line(self) -> str:
        """The line as `journalctl` prints it, in the time zone of this machine."""
        return f"{time.strftime('%b %d %H:%M:%S', time.localtime(self.time_s))} {self.source}: {self.text}"


@dataclass(frozen=True)
class SystemJournal:
    """The matching lines, oldest first; `readable` is False if the machine has no system journal."""

    units: tuple[JournalLine, ...]
    kernel: tuple[JournalLine, ...]
    readable: bool = True

    def matching(self, *words: str) -> tuple[JournalLine, ...]:
        """Return the lines of units and kernel that contain one of the words, ignoring case."""
        lowered = [word.lower() for word in words]
        return tuple(line for line in (*self.units, *self.kernel) if any(word in line.text.lower() for word in lowered))


def parse(output: Output) -> SystemJournal:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    if sections.get("no-journal"):
        return SystemJournal((), (), readable=False)
    sections.lines("end")  # missing if the probe was cut off
    return SystemJournal(_lines(sections.lines("units")), _lines(sections.lines("kernel")))


def _lines(raw_lines: tuple[str, ...]) -> tuple[JournalLine, ...]:
    found = []
    for raw in raw_lines:
        words = raw.split(" ", 3)
        try:
            time_s = float(words[0])
        except ValueError:
            continue  # the second line of an entry, or a message of journalctl itself
        source = words[2].rstrip(":") if len(words) > 2 else ""
        found.append(JournalLine(time_s, source, words[3].strip() if len(words) > 3 else "", raw))
    return tuple(found)


SYSTEM_JOURNAL = Fact("journal", PROBE, parse)
