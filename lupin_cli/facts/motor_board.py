"""The motor board: its place on the USB, and what it answers on its serial port while nobody else uses that.

While the vendor's service or its driver runs, the port is theirs and the board is not asked. Otherwise it gets the requests of
`lupin_runtime.board_protocol`, which change nothing on it.
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass, replace
from pathlib import Path

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, as_root_if_allowed, number, parse_sections
from lupin_cli.facts.units import VENDOR
from lupin_runtime.board_protocol import PROBE_REQUESTS, Chunk, Examination, examine

BY_ID = "/dev/serial/by-id"  # udev names the ports there by manufacturer and product
USB_VENDOR = "2e8a"  # Raspberry Pi
BOOT_LOADER, MICROPYTHON = "0003", "0005"  # products, of a Pico without the firmware of the motor board
ASK_LIMIT_S = 8  # the agent ends by itself before, unless the kernel's driver hangs
_AGENT = Path(__file__).with_name("board_agent.py").read_text(encoding="utf-8")

_USB = f"""echo '@@ usb'
for d in /sys/bus/usb/devices/*; do
  [ "$(cat "$d/idVendor" 2>/dev/null)" = {USB_VENDOR} ] || continue
  echo "${{d##*/}} $(cat "$d/idProduct") $(cat "$d/authorized" 2>/dev/null) $(cat "$d/product" 2>/dev/null)"
done
echo '@@ hub-ports'
for d in /sys/bus/usb/devices/*:*/*-port*; do
  [ "$(cat "$d/disable" 2>/dev/null)" = 1 ] && echo "$d disabled"
  n=$(cat "$d/over_current_count" 2>/dev/null) && [ "$n" -gt 0 ] && echo "$d over-current $n"
done
"""


def probe_script(by_id: str = BY_ID) -> str:
    """Return the probe: it prints the board's serial ports, and asks each unless it may be in use."""
    ask = f"""echo '@@ serial-ports'
ports=$(for s in {shlex.quote(by_id)}/*Raspberry_Pi*; do [ -e "$s" ] && readlink -f "$s"; done | sort -u)
printf '%s\\n' $ports
state=$(systemctl is-active {VENDOR} 2>/dev/null)
case $state in
  active | activating | reloading | deactivating | refreshing) reason="{VENDOR} is $state" ;;
  *) reason=$(grep -la '[t]elemetrix' /proc/[0-9]*/cmdline 2>/dev/null | sed -n '1s,/proc/\\(.*\\)/cmdline,process \\1 runs,p')
     command -v python3 >/dev/null || reason="there is no python3" ;;
esac
if [ -n "$reason" ]; then printf '@@ not-asked\\n%s\\n' "$reason"; else
  for port in $ports; do
    timeout -k 1 {ASK_LIMIT_S} python3 -I -u -c {shlex.quote(_AGENT)} "$port" {b"".join(PROBE_REQUESTS).hex()}
  done
fi
"""
    return f"{PRELUDE}{_USB}{as_root_if_allowed(ask)}echo '@@ end'\n"


@dataclass(frozen=True)
class UsbBoard:
    """A microcontroller of Raspberry Pi on the USB."""

    name: str  # of the device in /sys/bus/usb/devices, such as 1-1.2
    product: str  # its id, such as 000a
    authorized: bool  # whether the kernel may use it
    text: str  # its own name, such as Pico

    def line(self) -> str:
        """Return a one-line summary."""
        return f"usb {self.name}: {USB_VENDOR}:{self.product} {self.text}{'' if self.authorized else ' (authorized=0)'}"


@dataclass(frozen=True)
class AskedPort:
    """What happened on one serial port: nothing was sent because it is held or refused, or answers were awaited."""

    port: str
    holders: tuple[str, ...] = ()  # `PID NAME`
    refused: str = ""
    received: tuple[str, ...] = ()  # `SECONDS BYTES`, as the agent printed them
    failed: str = ""  # why the exchange ended early
    examination: Examination | None = None  # None if nothing was sent

    def lines(self) -> tuple[str, ...]:
        """Return what was observed, as evidence."""
        if self.examination is None:
            return (f"{self.port}: {self.refused or 'open in ' + ', '.join(self.holders)}",)
        summary = f"{self.port}: {self.examination.answer.value} after {len(PROBE_REQUESTS)} requests"
        if self.examination.version:
            summary += f"; firmware {self.examination.version} after {self.examination.answered_s:.2f} s"
        shown = [line[:80] for line in self.received[:3]]
        return (summary, *((f"{self.port}: {self.failed}",) if self.failed else ()), *shown)


@dataclass(frozen=True)
class MotorBoard:
    """The board as the robot's kernel and, if it was asked, the board itself describe it."""

    usb: tuple[UsbBoard, ...]
    hub_ports: tuple[str, ...]  # those without power: `PATH disabled`, `PATH over-current COUNT`
    serial_ports: tuple[str, ...]
    not_asked: str = ""  # why the board was not asked; empty if it was
    asked: tuple[AskedPort, ...] = ()


def parse(output: Output) -> MotorBoard:
    """Parse the output of the probe. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    asked: list[AskedPort] = []
    for section in sections.sections:
        lines = tuple(line for line in section.lines if line.strip())
        if section.name == "asked":
            asked.append(AskedPort(section.argument, refused="the probe was cut off"))
        elif section.name in ("held", "refused", "received", "failed") and asked:
            asked[-1] = _with_section(asked[-1], section.name, lines)
    return MotorBoard(
        usb=tuple(_usb_board(line) for line in sections.lines("usb")),
        hub_ports=sections.lines("hub-ports"),
        serial_ports=sections.lines("serial-ports"),
        not_asked=sections.text("not-asked") if sections.get("not-asked") else "",
        asked=tuple(asked),
    )


def _with_section(asked: AskedPort, name: str, lines: tuple[str, ...]) -> AskedPort:
    if name == "held":
        return replace(asked, holders=lines, refused="")
    if name == "refused":
        return replace(asked, refused=" ".join(lines))
    if name == "failed":
        return replace(asked, failed=" ".join(lines))
    return replace(asked, received=lines, refused="", examination=examine([_chunk(line) for line in lines]))


def _chunk(line: str) -> Chunk:
    after_s, _, data = line.partition(" ")
    return Chunk(number(after_s, "the time of received bytes"), bytes.fromhex(data))


def _usb_board(line: str) -> UsbBoard:
    words = line.split(" ", 3)
    if len(words) < 2:
        raise ValueError(f"expected a USB device, found {line[:80]!r}")
    return UsbBoard(words[0], words[1], words[2:3] != ["0"], words[3] if len(words) > 3 else "")


MOTOR_BOARD = Fact("motor-board", probe_script(), parse)
