"""Sentences that operators read on the page: what the robot and the console say is in the table that the page translates by."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from lupin_runtime.console.authority import Authority, Refused, Role, Session
from lupin_runtime.console.robot_sentences import SENTENCES
from lupin_runtime.console.stop_registry import HoldKind, StopHold
from lupin_runtime.console.voice_robot import AGENT_OF
from lupin_runtime.drive.arbiter import Arbiter
from lupin_runtime.safety.console_stop import ConsoleStop
from lupin_runtime.safety.estop import EstopSources
from lupin_runtime.safety.expected_sources import UNHEARD
from lupin_runtime.voice.tools import BY_NAME, TOOLS
from tests.support.voice_session import CALLS
from tests.support.voice_session import Session as VoiceSession

SECOND_NS = 1_000_000_000


def name_of(text: str) -> str:
    """Return the name of the sentence in the table; empty if it is none of them."""
    for name, template in SENTENCES.items():
        parts = [re.escape(part) for part in re.split(r"\{[^}]*\}", template)]
        if re.fullmatch(".+".join(parts), text):
            return name
    return ""


def test_every_reason_of_the_e_stop_is_a_sentence() -> None:
    pressed = EstopSources(ConsoleStop(), expected=tuple(UNHEARD))
    assert [name_of(each) for each in pressed.state(0, 0).reasons] == ["unheard_button", "unheard_console", "unheard_witness"]
    pressed.button(True, 0, 0)
    pressed.console_server('{"server": "a", "engaged": true, "driving": true, "presses": 1, "releases": 0}', 0)
    pressed.missed_press(False)
    assert [name_of(each) for each in pressed.state(0, 0).reasons] == ["button_pressed", "browser_holds_stop"]
    late_ns = 5 * SECOND_NS
    assert [name_of(each) for each in pressed.state(late_ns, late_ns).reasons] == [
        "button_pressed",
        "button_silent",
        "console_lost_driving",
    ]
    for is_known, name in ((True, "missed_press"), (False, "missed_press_or_silence")):
        missed = EstopSources(ConsoleStop())
        if is_known:
            missed.button(False, 0, 0)
        missed.missed_press(True)
        assert [name_of(each) for each in missed.state(0, 0).reasons] == [name]


def test_the_reasons_of_consoles_on_the_topic_are_sentences() -> None:
    consoles = ConsoleStop()
    consoles.update(True, 0)
    assert name_of(consoles.reason(0) or "") == "console_holds_stop"
    assert name_of(consoles.reason(5 * SECOND_NS) or "") == "console_lost_holding"
    silent = ConsoleStop()
    silent.update(False, 0)
    assert name_of(silent.reason(5 * SECOND_NS) or "") == "consoles_silent"


def test_every_lock_of_the_drive_bus_is_a_sentence() -> None:
    arbiter = Arbiter()
    assert [name_of(each) for each in arbiter.locks(0)] == ["estop_not_received"]
    arbiter.handle_estop_state(True, 0)
    arbiter.close(0)
    assert [name_of(each) for each in arbiter.locks(9 * SECOND_NS)] == ["bus_closed", "estop_engaged", "estop_silent"]


def test_refusals_of_control_are_sentences() -> None:
    authority = Authority(lambda _: None)
    holder, other, third = (Session(name, Role.OPERATOR) for name in ("laptop-1", "phone-2", "phone-3"))
    authority.take(holder, 0)
    authority.request(other, 0)
    refusals: dict[str, Callable[[], object]] = {
        "control_held": lambda: authority.take(other, SECOND_NS),
        "other_asks": lambda: authority.request(third, SECOND_NS),
        "has_no_control": lambda: authority.answer(other, True, SECOND_NS),
        "is_viewer": lambda: authority.take(Session("guest-4", Role.VIEWER), SECOND_NS),
        "not_allowed": lambda: authority.check_provide("/drive"),
    }
    for name, refused in refusals.items():
        with pytest.raises(Refused) as caught:
            refused()
        assert name_of(str(caught.value)) == name


@pytest.mark.parametrize("name", [tool.name for tool in TOOLS if tool.read_back])
def test_what_the_voice_agent_reads_back_is_a_sentence(name: str) -> None:
    for action in BY_NAME[name].read_back:
        given = {**CALLS[name], **({"action": action} if action else {})}
        sentence = BY_NAME[name].sentence(BY_NAME[name].check(given))
        assert name_of(sentence) == "_".join(filter(None, ("asks", name, action)))


def test_refusals_of_the_voice_agents_calls_are_sentences() -> None:
    session = VoiceSession()
    session.set(estop=("phone-2 stopped the robot",))
    refused = session.refusal("rotate", {"angle_deg": 90.0})
    assert name_of(refused["error"]) == "call_estopped"
    assert [name_of(each["untrusted"]) for each in refused["reasons"]] == ["hold_left"]
    for _ in range(2):
        session.refusal("rotate", {"angle_deg": 90.0})
    assert name_of(session.refusal("rotate", {"angle_deg": 90.0})["error"]) == "call_cut_off"
    assert name_of(session.envelope.turns.cut_off) == "cut_off_insists"


def test_every_hold_of_the_stop_is_a_sentence() -> None:
    for kind in HoldKind:
        assert name_of(StopHold("press", "phone-2", kind, 0).text) == f"hold_{kind.value}"
    assert name_of(AGENT_OF.format(name="phone-2")) == "voice_agent_of"
