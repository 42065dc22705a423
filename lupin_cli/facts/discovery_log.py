"""How the vendor's discovery server started in this boot: the vendor's setting, its unit, and lines of the system journal."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, as_root_if_allowed, parse_sections

# Messages of Fast DDS and of its fast-discovery-server.
_WORDS = "allocate the specified listening port|fast-discovery-server.*not found|couldn.t allocate port|Discovery Server"
_READ_JOURNAL = f"""journalctl -b -q --no-pager -o short -u mirte-ros.service -n 20000 |
  grep -E "{_WORDS}" | {{ head -n 10; tail -n 5; }}"""
PROBE = (
    PRELUDE
    + """units=$([ ! -d /run/systemd/system ] || systemctl show -p ActiveState,ActiveEnterTimestampMonotonic \
  mirte-ros.service mirte-ap.service mirte-wifi-watchdog.service)
echo '@@ settings'; grep -hsE '^[^#]*MIRTE_FASTDDS' "$HOME/.mirte_settings.sh"
echo '@@ unit'; printf '%s\\n' "$units" | sed -n 's/^ActiveState=//p'
echo '@@ since'; printf '%s\\n' "$units" | sed -n 's/^ActiveEnterTimestampMonotonic=//p'
echo '@@ uptime'; cat /proc/uptime
echo '@@ journal'
command -v journalctl >/dev/null || exit 0
"""
    + as_root_if_allowed(_READ_JOURNAL)
    + "exit 0\n"
)

_SWITCH = re.compile(r"^\s*(?:export\s+)?MIRTE_FASTDDS=[\"']?([^\"'\s]*)")


@dataclass(frozen=True)
class DiscoveryLog:
    """The vendor's discovery settings. Unit states are systemd's; empty if systemd is not PID 1."""

    switch: str  # last value of MIRTE_FASTDDS in the settings file; empty if unset
    vendor: str = ""
    access_point: str = ""
    watchdog: str = ""
    journal: tuple[str, ...] = ()  # lines of the system journal, of this boot
    vendor_age_s: float | None = None  # time since its unit became active; None if it never did

    @property
    def server_enabled(self) -> bool:
        """Whether the vendor's script starts a discovery server: it compares the value with `true`, and nothing else."""
        return self.switch == "true"


def parse(output: Output) -> DiscoveryLog:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    switches = [match[1] for line in sections.lines("settings") if (match := _SWITCH.match(line))]
    states = [*sections.lines("unit"), "", "", ""]
    since_us = sections.text("since")
    age_s = sections.number("uptime") - int(since_us) / 1e6 if since_us.isdigit() and since_us != "0" else None
    return DiscoveryLog(
        switches[-1] if switches else "",
        vendor=states[0],
        access_point=states[1],
        watchdog=states[2],
        journal=sections.lines("journal"),
        vendor_age_s=None if age_s is None else round(age_s, 1),
    )


DISCOVERY_LOG = Fact("discovery-log", PROBE, parse)
