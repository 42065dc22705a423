"""The agents at both ends of a path: in this process, and on the robot over a channel of the SSH connection."""

from __future__ import annotations

import contextlib
import json
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from lupin_cli.link.path_agent import Agent
from lupin_runtime.json_text import parse_json

if TYPE_CHECKING:
    import paramiko

AGENT_TIMEOUT_S = 8.0  # the longest wait for one answer of the robot's end
MAX_ANSWER_BYTES = 1 << 20  # the longest answers list a machine's firewall rules and ports


class PathError(RuntimeError):
    """The robot's end of the path cannot be asked; the message says why."""


class Peer(Protocol):
    """An agent at one end."""

    def ask(self, do: str, **arguments: Any) -> Any:
        """Return the agent's answer. Raises PathError."""


class LocalPeer:
    """The agent of this machine."""

    def __init__(self) -> None:
        self._agent = Agent()

    def ask(self, do: str, **arguments: Any) -> Any:
        """See `Peer.ask`."""
        return parse_json(json.dumps(getattr(self._agent, do)(**arguments)))

    def close(self) -> None:
        """Close the agent's sockets."""
        self._agent.close()


class RemotePeer:
    """The agent on the robot, over a channel of the SSH connection."""

    def __init__(self, channel: paramiko.Channel) -> None:
        self._channel = channel
        self._channel.settimeout(AGENT_TIMEOUT_S)
        self._buffer = b""

    def ask(self, do: str, **arguments: Any) -> Any:
        """See `Peer.ask`."""
        try:
            self._channel.sendall(json.dumps({"do": do, **arguments}).encode() + b"\n")
            while b"\n" not in self._buffer:
                if not (data := self._channel.recv(65536)):
                    raise PathError("the robot's end of the measurement exited")
                self._buffer += data
                if len(self._buffer) > MAX_ANSWER_BYTES:
                    raise PathError(f"the robot's end of the measurement printed more than {MAX_ANSWER_BYTES} bytes")
        except OSError as error:
            raise PathError(f"the robot's end of the measurement did not answer: {error}") from error
        line, _, self._buffer = self._buffer.partition(b"\n")
        try:
            return parse_json(line)
        except ValueError:
            raise PathError(f"the robot's end of the measurement printed {line[:80]!r}") from None


class ChannelOpener(Protocol):
    """A robot over SSH."""

    def open_run(self, script: str, timeout_s: float) -> paramiko.Channel:
        """Start a script and return its channel."""


@contextlib.contextmanager
def remote_peer(robot: ChannelOpener) -> Iterator[RemotePeer]:
    """Run the agent on the robot during the block. Raises TargetError."""
    code = Path(__file__).with_name("path_agent.py").read_text(encoding="utf-8")
    with contextlib.closing(robot.open_run(f"exec python3 -I -c {shlex.quote(code)}", 30.0)) as channel:
        yield RemotePeer(channel)
