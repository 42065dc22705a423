"""How the vendor's discovery server came up at this boot: the vendor's switch, its unit, and what the journal says."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, answers
from lupin_cli.target.base import Output

# The words of Fast DDS and of its tool.
_WORDS = "allocate the specified listening port|fast-discovery-server.*not found|couldn.t allocate port|Discovery Server"
PROBE = (
    PRELUDE
    + rf"""as=; [ "$(id -u)" = 0 ] || {{ command -v sudo >/dev/null && sudo -n true 2>/dev/null && as='sudo -n'; }}
echo '@@ settings'; grep -hsE '^[^#]*MIRTE_FASTDDS' "$HOME/.mirte_settings.sh"
echo '@@ unit'; [ -d /run/systemd/system ] && systemctl is-active mirte-ros.service mirte-ap.service mirte-wifi-watchdog.service
echo '@@ journal'
command -v journalctl >/dev/null && {{ $as journalctl -b -q --no-pager -o short -u mirte-ros.service -n 20000 2>/dev/null |
  grep -E "{_WORDS}" | {{ head -n 10; tail -n 5; }}; }}
exit 0
"""
)

_SWITCH = re.compile(r"^\s*(?:export\s+)?MIRTE_FASTDDS=[\"']?([^\"'\s]*)")


@dataclass(frozen=True)
class DiscoveryLog:
    """The vendor's side of discovery. States are systemd's; "" where it isn't PID 1."""

    switch: str  # last value of MIRTE_FASTDDS in the settings file; "" unset
    vendor: str = ""
    access_point: str = ""
    watchdog: str = ""
    journal: tuple[str, ...] = ()  # of this boot

    @property
    def wanted(self) -> bool:
        """Whether the vendor's side is told to use a discovery server."""
        return self.switch not in ("", "false")


def parse(output: Output) -> DiscoveryLog:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    switches = [match[1] for line in said.lines("settings") if (match := _SWITCH.match(line))]
    states = [*said.lines("unit"), "", "", ""]
    return DiscoveryLog(switches[-1] if switches else "", states[0], states[1], states[2], said.lines("journal"))


DISCOVERY_LOG = Fact("discovery-log", PROBE, parse)
