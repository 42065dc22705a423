"""Temperatures, and whether the processor is throttled because of them."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, parse_sections

PROBE = (
    PRELUDE
    + """for z in /sys/class/thermal/thermal_zone*; do
  [ -r "$z/temp" ] || continue
  echo "@@ zone ${z##*/} $(cat "$z/type" 2>/dev/null)"; echo "temp $(cat "$z/temp" 2>/dev/null)"
  for t in "$z"/trip_point_*_temp; do [ -r "$t" ] && echo "$(cat "${t%_temp}_type" 2>/dev/null) $(cat "$t" 2>/dev/null)"; done
done
for c in /sys/class/thermal/cooling_device*; do
  [ -r "$c/cur_state" ] || continue
  echo "@@ cooling ${c##*/} $(cat "$c/type" 2>/dev/null)"
  echo "$(cat "$c/cur_state" 2>/dev/null) of $(cat "$c/max_state" 2>/dev/null)"
done
for p in /sys/devices/system/cpu/cpufreq/policy*; do
  [ -r "$p/scaling_cur_freq" ] || continue
  echo "@@ cpufreq ${p##*/}"
  echo "$(cat "$p/scaling_cur_freq") $(cat "$p/scaling_max_freq") $(cat "$p/cpuinfo_max_freq") $(cat "$p/scaling_governor")"
done
if command -v vcgencmd >/dev/null 2>&1; then echo '@@ vcgencmd'; timeout 1 vcgencmd get_throttled 2>&1; fi
echo '@@ end'
"""
)

# Bits of `vcgencmd get_throttled` that describe the current state (Raspberry Pi documentation).
THROTTLED_NOW = {0: "under-voltage", 1: "arm frequency capped", 2: "throttled", 3: "soft temperature limit"}


@dataclass(frozen=True)
class Zone:
    """A sensor and the temperatures at which the kernel acts, in degrees Celsius."""

    name: str
    kind: str
    temperature_c: float
    passive_c: float | None  # the processor is throttled from this temperature on
    critical_c: float | None  # the machine shuts down


@dataclass(frozen=True)
class Thermal:
    """The thermal state of a machine; empty if it has no sensors, like a container."""

    zones: tuple[Zone, ...]
    slowed: tuple[str, ...]  # active cooling devices that throttle the processor, as lines
    capped: tuple[str, ...]  # frequency policies below the hardware's maximum, as lines
    firmware: tuple[str, ...]  # throttling that the firmware reports, as lines


def parse(output: Output) -> Thermal:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    zones = []
    for section in sections.all("zone"):
        name, _, kind = section.argument.partition(" ")
        readings = [line.split() for line in section.lines if len(line.split()) == 2]
        values = [(key, int(text) / 1000.0) for key, text in readings if text.lstrip("-").isdigit()]
        temperature = next((value for key, value in values if key == "temp"), None)
        # The kernel reports -274 for a sensor that was not read yet, and 0 for a trip point that is not set.
        if temperature is None or not -60.0 < temperature < 250.0:
            continue
        trips = [(key, value) for key, value in values if key != "temp" and value > 0.0]
        passive = [value for key, value in trips if key == "passive"]
        critical = [value for key, value in trips if key == "critical"]
        zones.append(Zone(name, kind, temperature, min(passive, default=None), min(critical, default=None)))
    slowed = []
    for section in sections.all("cooling"):
        words = section.text.split()
        kind = section.argument.partition(" ")[2].lower()
        # A running fan is normal; only throttling of the processor matters.
        if words[:1] and words[0].isdigit() and int(words[0]) > 0 and ("cpu" in kind or "processor" in kind):
            slowed.append(f"{section.argument}: cur_state {section.text}")
    capped = []
    for section in sections.all("cpufreq"):
        words = section.text.split()
        if len(words) >= 3 and all(word.isdigit() for word in words[:3]) and int(words[1]) < int(words[2]):
            capped.append(f"{section.argument}: scaling_max_freq {words[1]} of cpuinfo_max_freq {words[2]}")
    firmware = sections.get("vcgencmd")
    return Thermal(tuple(zones), tuple(slowed), tuple(capped), _firmware(firmware.text if firmware else ""))


def _firmware(line: str) -> tuple[str, ...]:
    key, _, value = line.partition("=")
    if key.strip() != "throttled":
        return ()
    try:
        bits = int(value, 16)
    except ValueError:
        return ()
    return tuple(f"{line}: {word}" for bit, word in THROTTLED_NOW.items() if bits >> bit & 1)


THERMAL = Fact("thermal", PROBE, parse)
