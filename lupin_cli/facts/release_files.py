"""What is not as it was signed in the current release: damaged, missing or added files, or the signature."""

from __future__ import annotations

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, parse_sections
from lupin_cli.release.paths import RELEASE
from lupin_cli.release.verification import parse_damage, verification_script
from lupin_cli.release.verify_release import MANIFEST, SIGNED

MAX_PATHS = 20
# A running service has been verified at its start. Reading every file takes seconds on an SD card, so it is done only without.
_IS_RUNNING = "systemctl is-active --quiet lupin-onboard.service 2>/dev/null"
PROBE = (
    PRELUDE
    + f"""if [ -e {RELEASE}/{MANIFEST} ] || [ -e {RELEASE}/{SIGNED} ]; then
echo '@@ damaged'
{verification_script(RELEASE, quick_if=_IS_RUNNING)}fi
echo '@@ end'
"""
)


def parse(output: Output) -> tuple[str, ...]:
    """Parse the output of PROBE: at most MAX_PATHS paths, each with a reason in parentheses. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    damaged = sections.get("damaged")
    return parse_damage("\n".join(damaged.lines))[:MAX_PATHS] if damaged else ()


RELEASE_FILES = Fact("release-files", PROBE, parse, timeout_s=30.0)
