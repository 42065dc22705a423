"""`discovery-server`: the robot's discovery server listens on every address."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.shell import change, observe, query, quote, text_of
from lupin_runtime.ports import DISCOVERY_PORT

# The vendor's client profile must not be in the server's environment: the server would use it and try to take its port.
# The shell that starts the server exits at once, so the server needs a session of its own. Its PID is stored beside its log, in
# a folder of its user: in /tmp another user could plant a link in place of the log, or name the process that undo terminates.
_START = r"""
tool=$(command -v fast-discovery-server || ls /opt/ros/*/bin/fast-discovery-server 2>/dev/null | head -n 1)
[ -n "$tool" ] || { echo 'there is no fast-discovery-server, neither in PATH nor in /opt/ros/*/bin' >&2; exit 1; }
case $tool in
  /opt/ros/*) LD_LIBRARY_PATH=${tool%/bin/*}/lib; export LD_LIBRARY_PATH ;;
esac
log=LOG
(umask 077 && mkdir -p -- "$(dirname -- "$log")") || exit 1
export tool log
env -u FASTRTPS_DEFAULT_PROFILES_FILE -u ROS_DISCOVERY_SERVER setsid sh -c \
  'echo $$ >"$log.pid"; exec "$tool" -i 0 -l 0.0.0.0 -p PORT' >"$log" 2>&1 </dev/null &
exit 0
"""
_STOP = r"""
log=LOG
[ -r "$log.pid" ] || exit 0
read -r pid <"$log.pid"
case $pid in '' | *[!0-9]*) pid=none ;; esac
[ "$(cat "/proc/$pid/comm" 2>/dev/null)" = fast-discovery- ] || { rm -f -- "$log.pid"; exit 0; }
kill "$pid"
n=0
while [ "$n" -lt 50 ] && [ -d "/proc/$pid" ]; do sleep 0.1; n=$((n + 1)); done
[ ! -d "/proc/$pid" ] && rm -f -- "$log.pid"
"""
_PAUSE_S = 0.5
_WILDCARD_ADDRESSES = ("0.0.0.0", "*", "[::]")  # as ss(8) prints them


@dataclass(frozen=True, kw_only=True)
class DiscoveryServer(Operation):
    """Nodes retry 127.0.0.1 forever, so they connect within seconds once a server listens; nothing else is restarted.

    A vendor's server that listens on every address is left alone. One that listens on a single address is an error, since it
    would answer on one link but not on the other; restarting the vendor's service is the operator's decision.
    """

    name: ClassVar[str] = "discovery-server"
    effect: ClassVar[str] = f"a discovery server listens on UDP `port` (default {DISCOVERY_PORT}), on every address"
    undo_effect: ClassVar[str] = "the server that the step started is terminated by PID"
    settle_s: ClassVar[float] = 10.0
    report_keys: ClassVar[tuple[str, ...]] = ("listens",)

    port: int = DISCOVERY_PORT
    patience_s: float = 0.0  # how long to wait for the vendor's own server after its service was started
    log: str = "~/.local/state/lupin/discovery-server.log"

    def __post_init__(self) -> None:
        if not 1 <= self.port <= 65535:
            raise ValueError(f"a port is from 1 to 65535, not {self.port}")

    @property
    def inspect_command(self) -> str:
        return f"cat {self.log}"

    def probe(self) -> Script:
        return probe_script(f"ss -H -lnu 'sport = :{self.port}'")

    def _addresses(self, output: Output) -> list[str]:
        lines = [line.split() for line in text_of(output, "the listening sockets").splitlines()]
        if any(len(words) < 4 or not words[3].endswith(f":{self.port}") for words in lines):
            raise OperationError(f"could not read the listening sockets: found {output.stdout[:80]!r}", "ss -lnu")
        return [words[3].rpartition(":")[0].partition("%")[0] for words in lines]

    def judge(self, output: Output) -> Difference | None:
        addresses = self._addresses(output)
        if any(address in _WILDCARD_ADDRESSES for address in addresses):
            return None
        if addresses:
            raise OperationError(
                f"the {self.machine}'s discovery server listens on {', '.join(addresses)} only, not on every address",
                "sudo systemctl restart mirte-ros",
            )
        return Difference(f"start a discovery server on UDP {self.port}, where nothing listens", "", {"listened": False})

    def change(self, target: Target, difference: Difference) -> None:
        deadline = time.monotonic() + self.patience_s
        while time.monotonic() < deadline:
            if self._addresses(observe(self, target)):
                return
            time.sleep(_PAUSE_S)
        script = _START.replace("PORT", str(self.port)).replace("LOG", quote(self.log))
        change(target, script, "start the discovery server", timeout_s=20.0, next_command=self.inspect_command)

    def report(self, output: Output) -> dict[str, Any]:
        return {"listens": bool(self._addresses(output))}

    def undo(self, target: Target, before: Mapping[str, Any]) -> None:
        change(target, _STOP.replace("LOG", quote(self.log)), "terminate the discovery server", timeout_s=20.0)
        query(target, "true")
