"""`discovery-server`: the robot's discovery server listens, on every address."""

from __future__ import annotations

import time
from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.shell import change, look, read
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target

# The profile must not be in its environment: it would make a server of the vendor's client profile, whose port it can't take.
# The shell that starts it is gone at once, so it needs a session of its own. Its number lies beside its log.
_START = r"""
tool=$(command -v fast-discovery-server || ls /opt/ros/*/bin/fast-discovery-server 2>/dev/null | head -n 1)
[ -n "$tool" ] || { echo 'there is no fast-discovery-server, neither in PATH nor in /opt/ros/*/bin' >&2; exit 1; }
case $tool in
  /opt/ros/*) LD_LIBRARY_PATH=${tool%/bin/*}/lib; export LD_LIBRARY_PATH ;;
esac
export tool
env -u FASTRTPS_DEFAULT_PROFILES_FILE -u ROS_DISCOVERY_SERVER setsid sh -c \
  'echo $$ >LOG.pid; exec "$tool" -i 0 -l 0.0.0.0 -p PORT' >LOG 2>&1 </dev/null &
exit 0
"""
_STOP = r"""
[ -r LOG.pid ] || exit 0
read -r pid <LOG.pid
[ "$(cat "/proc/$pid/comm" 2>/dev/null)" = fast-discovery- ] || { rm -f LOG.pid; exit 0; }
kill "$pid"
n=0
while [ "$n" -lt 50 ] && [ -d "/proc/$pid" ]; do sleep 0.1; n=$((n + 1)); done
[ ! -d "/proc/$pid" ] && rm -f LOG.pid
"""


_PAUSE_S = 0.5


@dataclass(frozen=True, kw_only=True)
class DiscoveryServer:
    """Nodes ask 127.0.0.1 for ever: once a server is bound, they attach within seconds; nothing else is restarted.

    The vendor's own server is left alone where it listens. One that is bound to a single address is an error: it would answer
    on one link and not on the other, and it is the vendor's service that has to be told.
    """

    name: ClassVar[str] = "discovery-server"
    settle_s: ClassVar[float] = 10.0
    reports: ClassVar[tuple[str, ...]] = ("listens",)

    port: int = 11811
    patience_s: float = 0.0  # the vendor's service was only just started: its own server may still come
    log: str = "/tmp/lupin-disc.log"
    machine: str = "robot"

    def __post_init__(self) -> None:
        if not 1 <= self.port <= 65535:
            raise ValueError(f"a port lies between 1 and 65535, unlike {self.port}")

    @property
    def look_command(self) -> str:
        return f"cat {self.log}"

    def _addresses(self, target: Target) -> list[str]:
        text = read(target, f"ss -H -lnu 'sport = :{self.port}'", "the listening sockets")
        return [line.split()[3].rpartition(":")[0].partition("%")[0] for line in text.splitlines() if len(line.split()) > 3]

    def differs(self, target: Target) -> Difference | None:
        addresses = self._addresses(target)
        if any(address in ("0.0.0.0", "*", "[::]") for address in addresses):
            return None
        if addresses:
            raise OperationError(
                f"the discovery server of {target.name} listens on {', '.join(addresses)} only, not on every address",
                "sudo systemctl restart mirte-ros",
            )
        return Difference(f"a discovery server is started on UDP {self.port}: nobody listens there", "", {"listened": False})

    def change(self, target: Target, difference: Difference) -> None:
        deadline = time.monotonic() + self.patience_s
        while time.monotonic() < deadline:
            if self._addresses(target):
                return
            time.sleep(_PAUSE_S)
        script = _START.replace("PORT", str(self.port)).replace("LOG", self.log)
        change(target, script, "start the discovery server", bound_s=20.0, next_command=self.look_command)

    def report(self, target: Target) -> dict[str, Any]:
        return {"listens": bool(self._addresses(target))}

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        change(target, _STOP.replace("LOG", self.log), "end the discovery server", bound_s=20.0)
        look(target, "true")
