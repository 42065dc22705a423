"""USB devices, cameras and serial ports, and the processes that hold them open."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, as_root_if_allowed, parse_sections

# Prints the service of a control group, if the system's manager runs it. What a person runs, below user.slice, has none: the
# last name there may be user@1000.service, which is the whole session.
SERVICE_OF_GROUP = r"sed -n '/\/user\.slice\//d; s,.*/\([^/]*\.service\).*,\1,p'"
# Only root can read the open files of other users' processes.
_FIND_HOLDERS = """find /proc/[0-9]*/fd -maxdepth 1 \\( -lname '/dev/video*' -o -lname '/dev/ttyACM*' \\
  -o -lname '/dev/ttyUSB*' -o -lname '/dev/bus/usb/*' -o -lname '/dev/media*' \\) -printf '%p %l\\n'"""
PROBE = (
    PRELUDE
    + """echo '@@ usb'
for d in /sys/bus/usb/devices/*; do
  [ -r "$d/idVendor" ] || continue
  echo "${d##*/} $(cat "$d/idVendor"):$(cat "$d/idProduct") $(cat "$d/product" 2>/dev/null)"
done
echo '@@ video'; for v in /sys/class/video4linux/*; do [ -e "$v" ] && echo "/dev/${v##*/} $(cat "$v/name" 2>/dev/null)"; done
echo '@@ serial'; for s in /dev/ttyACM* /dev/ttyUSB*; do [ -e "$s" ] && echo "$s $(stat -c '%U:%G %a' "$s")"; done
echo '@@ by-id'; for s in /dev/serial/by-id/*; do [ -e "$s" ] && echo "$(readlink -f "$s") ${s##*/}"; done
echo '@@ holders'
held() {
"""
    + as_root_if_allowed(_FIND_HOLDERS)
    + f"""}}
service_of() {{ {SERVICE_OF_GROUP} "/proc/$1/cgroup" 2>/dev/null | head -n 1; }}
"""
    + """held | while read -r f dev; do
  p=${f#/proc/}; p=${p%%/*}; u=$(service_of "$p")
  echo "$p $dev ${u:--} $(cat "/proc/$p/comm" 2>/dev/null) $(tr '\\0' ' ' <"/proc/$p/cmdline" 2>/dev/null | cut -c1-200)"
done | sort -u
echo '@@ board'
for c in $(grep -la '[t]elemetrix' /proc/[0-9]*/cmdline 2>/dev/null); do
  p=${c#/proc/}; p=${p%/cmdline}
  s=$(sed -n 's/^State:[[:space:]]*//p' "/proc/$p/status" 2>/dev/null)
  echo "$p ${s%% *} $(tr '\\0' ' ' <"$c" 2>/dev/null | cut -c1-200)"
done
echo '@@ end'
"""
)


@dataclass(frozen=True)
class Holder:
    """A process that holds a device open."""

    pid: int
    device: str
    unit: str  # the service it belongs to, or `-`
    program: str
    command: str

    def line(self) -> str:
        """Return a one-line summary."""
        return f"{self.device} held by {self.program} (pid {self.pid}, {self.unit}): {self.command}"


@dataclass(frozen=True)
class Video:
    """A video device, with the name that its driver reports."""

    device: str
    name: str


@dataclass(frozen=True)
class TelemetrixProcess:
    """A process of Telemetrix, the vendor's driver of the motor board."""

    pid: int
    state: str  # R, S, D, Z or T, as in /proc/PID/status
    command: str


@dataclass(frozen=True)
class Devices:
    """The devices of a machine, and the processes that use them."""

    usb: tuple[str, ...]  # `1-1.2 1a86:7523 USB Serial`
    videos: tuple[Video, ...]
    serials: tuple[str, ...]  # `/dev/ttyACM0 root:dialout 660`
    by_id: tuple[str, ...]  # `/dev/ttyACM0 usb-Raspberry_Pi_Pico_...`
    holders: tuple[Holder, ...]
    telemetrix: tuple[TelemetrixProcess, ...]

    def holders_of(self, prefix: str) -> tuple[Holder, ...]:
        """Return the processes that hold devices whose path starts with `prefix`."""
        return tuple(holder for holder in self.holders if holder.device.startswith(prefix))


def parse(output: Output) -> Devices:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    holders = []
    for line in sections.lines("holders"):
        words = line.split(" ", 4)
        if len(words) >= 4 and words[0].isdigit():
            holders.append(Holder(int(words[0]), words[1], words[2], words[3], words[4].strip() if len(words) > 4 else ""))
    processes = []
    for line in sections.lines("board"):
        words = line.split(" ", 2)
        if len(words) == 3 and words[0].isdigit():
            processes.append(TelemetrixProcess(int(words[0]), words[1], words[2].strip()))
    videos = [line.partition(" ") for line in sections.lines("video")]
    return Devices(
        usb=sections.lines("usb"),
        videos=tuple(Video(device, name.strip()) for device, _, name in videos),
        serials=sections.lines("serial"),
        by_id=sections.lines("by-id"),
        holders=tuple(holders),
        telemetrix=tuple(processes),
    )


DEVICES = Fact("devices", PROBE, parse)
