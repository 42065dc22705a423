"""A voice session on a bridge that records, with the listener that a test speaks for."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from typing import Any, cast

from lupin_runtime.console.authority import Authority, Role, Session
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.command_era import OUTDATED
from lupin_runtime.console.outbox import Frame
from lupin_runtime.console.robot_watch import RobotWatch
from lupin_runtime.console.settings import SETTINGS
from lupin_runtime.console.voice_listener import ListenerState, ListenerUser, VoiceListener
from lupin_runtime.console.voice_session import VoiceSession
from lupin_runtime.voice.envelope import Envelope
from lupin_runtime.voice.listener_protocol import Kind

ME = Session("phone-1", Role.OPERATOR)


class FakeBridge:
    """Records what is asked of it. Service calls wait until the test answers them."""

    def __init__(self) -> None:
        self.authority = Authority(lambda _: None)
        self.manual = self  # which this stands for as well
        self.authority.on_change(self._note_control)
        self.log: list[Any] = []
        self.recorded: list[tuple[str, str]] = []
        self.calls: list[tuple[str, Callable[[bool, Any], None]]] = []
        self.era = 0  # counts stops, releases and changes of control
        self.unheard: set[str] = set()  # topics without a subscriber

    def _note_control(self) -> None:
        self.era += 1

    def join(self, _client: Any) -> None:
        self.log.append("join")

    def leave(self, _client: Any) -> None:
        self.log.append("leave")

    def record(self, _session: str, what: str, _detail: Any = None, refused: str = "") -> None:
        self.recorded.append((what, refused))

    def log_request(self, _session: Session, level: str, text: str) -> None:
        self.log.append((level, text))

    def command_refusal(self) -> Callable[[], str]:
        era = self.era
        return lambda: "" if self.era == era else OUTDATED

    def is_driven_by_others(self, _client: Any) -> bool:
        return False

    def stops(self) -> list[dict[str, Any]]:
        return []

    def stop_for(self, session: Session) -> None:
        self.log.append(f"stop of {session.name}")

    def drive(self, _client: Any, twist: dict[str, dict[str, float]]) -> None:
        self.log.append(twist["linear"]["x"])

    def publish(self, _client: Any, topic: str, *_: Any, **__: Any) -> None:
        self.log.append(topic)

    def call_service(self, _client: Any, service: str, _arguments: Any, _timeout_s: float, done: Callable[..., None]) -> None:
        self.calls.append((service, done))

    def run_with_node(self, function: Callable[[Any], Any]) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(function(self))
        return future

    def count_subscribers(self, topic: str) -> int:
        """Of the node, which this stands for as well."""
        return 0 if topic in self.unheard else 1


class FakeWatch:
    """A robot whose light strip has said nothing."""

    def light_rule(self) -> str:
        return ""


class FakeListener:
    """Notes what is sent to it; the test says what it hears."""

    def __init__(self) -> None:
        self.state = ListenerState("ready")
        self.user: ListenerUser | None = None
        self.sent: list[tuple[Kind, bytes]] = []

    def start(self, user: ListenerUser) -> ListenerState:
        self.user = user
        return self.state

    def stop(self, _user: ListenerUser) -> None:
        self.user = None

    def send(self, _user: ListenerUser, kind: Kind, payload: bytes) -> None:
        self.sent.append((kind, payload))


class Rig:
    """A voice session in its first turn, and what it has sent."""

    def __init__(self) -> None:
        self.bridge = FakeBridge()
        self.listener = FakeListener()
        self.sent: list[dict[str, Any]] = []
        self.sounds: list[bytes] = []
        self.session = VoiceSession(
            ME,
            cast(Bridge, self.bridge),
            Envelope(),
            cast(RobotWatch, FakeWatch()),
            lambda: {setting.name: setting.default for setting in SETTINGS},
            self._change_location,
            self._receive,
            cast(VoiceListener, self.listener),
        )
        self.send(turn={"id": "1", "by": "text"})

    def _receive(self, frame: Frame) -> None:
        if frame.binary:
            self.sounds.append(frame.data)
        else:
            self.sent.append(json.loads(frame.data))

    async def _change_location(self, session: Session, name: str, pose: dict[str, float]) -> None:
        self.bridge.log.append((session.name, name, pose))

    def send(self, **message: Any) -> None:
        self.session.handle(json.dumps(message))

    def call(self, identifier: str, tool: str, /, **arguments: Any) -> None:
        self.send(call={"id": identifier, "name": tool, "arguments": arguments})

    def listen(self, mode: str) -> ListenerUser:
        """Begin to listen, and return what the listener calls."""
        self.send(listen={"mode": mode})
        assert self.listener.user is not None
        return self.listener.user

    def messages(self, kind: str) -> list[Any]:
        """Return what was sent of one kind."""
        return [message[kind] for message in self.sent if kind in message]

    def responses(self) -> dict[str, dict[str, Any]]:
        results = [message["result"] for message in self.sent if "result" in message]
        return {result["id"]: result["response"] for result in results}


def run(test: Callable[[Rig], Awaitable[None]]) -> Rig:
    async def main() -> Rig:
        rig = Rig()
        await test(rig)
        return rig

    return asyncio.run(main())


async def settle() -> None:
    """Let everything run that does not wait for an answer."""
    for _ in range(20):
        await asyncio.sleep(0)
