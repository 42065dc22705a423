"""Lines of this boot's journal that tell of trouble: of Lupin's units, of the vendor's, and of the kernel."""

from __future__ import annotations

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, answers, as_root_if_allowed
from lupin_cli.facts.units import OURS, VENDOR
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

KEPT_LINES = 60
LOOKED_AT_LINES = 4000
# What programs under these units say goes to the journal at one priority, whatever its weight: only the words tell.
# `exit code -11` is how a launch reports a spawner that the clock's step killed.
WORDS = (
    "error|fatal|exception|traceback|wasn.t able|not found|exit code|exited|failed|no such|timed out|"
    "died|killed|too quickly|disconnect|could ?n.t|refused|denied"
)
KERNEL_WORDS = (
    "out of memory|oom-kill|usb .*(disconnect|error|reset|not accepting|unable to enumerate)|cdc_acm|ttyACM|ttyUSB|"
    "under.?voltage|thermal|throttl|i/o error|ext4-fs error|remount.*read-only|mmc.*(error|timeout)"
)
_UNITS = " ".join(f"-u {unit}" for unit in (VENDOR, *OURS))

# Without membership of adm or systemd-journal a user sees only his own lines.
_READ = f"""j() {{ journalctl -b --no-pager -q -o short-unix -n {LOOKED_AT_LINES} "$@"; }}
echo "@@ reader $(id -un)"
echo '@@ units'
j {_UNITS} | grep -iE "{WORDS}" | tail -n {KEPT_LINES}
echo '@@ kernel'
j -k | grep -iE "{KERNEL_WORDS}" | tail -n {KEPT_LINES}
echo '@@ end'"""
PROBE = (
    PRELUDE + "if ! command -v journalctl >/dev/null 2>&1; then echo '@@ no-journal'; exit 0; fi\n" + as_root_if_allowed(_READ)
)


@dataclass(frozen=True)
class JournalLine:
    """One line. `time_s` is the wall clock of the machine when it was written, which a step of the clock belies."""

    time_s: float
    source: str  # the syslog identifier with its PID, or `kernel`
    text: str
    raw: str


@dataclass(frozen=True)
class Journal:
    """The telling lines, oldest first; `readable` is False where the machine keeps no journal."""

    units: tuple[JournalLine, ...]
    kernel: tuple[JournalLine, ...]
    readable: bool = True

    def matching(self, *words: str) -> tuple[JournalLine, ...]:
        """Lines of units and kernel that contain one of the words, whatever the case."""
        lowered = [word.lower() for word in words]
        return tuple(line for line in (*self.units, *self.kernel) if any(word in line.text.lower() for word in lowered))


def parse(output: Output) -> Journal:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    if said.maybe("no-journal"):
        return Journal((), (), readable=False)
    said.lines("end")  # a probe that was cut has not said all
    return Journal(_lines(said.lines("units")), _lines(said.lines("kernel")))


def _lines(raw_lines: tuple[str, ...]) -> tuple[JournalLine, ...]:
    found = []
    for raw in raw_lines:
        words = raw.split(" ", 3)
        try:
            time_s = float(words[0])
        except ValueError:
            continue  # the second line of an entry, or journalctl's own remarks
        source = words[2].rstrip(":") if len(words) > 2 else ""
        found.append(JournalLine(time_s, source, words[3].strip() if len(words) > 3 else "", raw))
    return tuple(found)


JOURNAL = Fact("journal", PROBE, parse)
