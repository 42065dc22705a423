"""The order of a voice session's calls: one after the other, and stops before all that waits. The bridge is a recorder."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from lupin_runtime import graph
from lupin_runtime.console.command_era import OUTDATED
from lupin_runtime.console.voice_session import INTERRUPTED, PAGE_CLOSED
from lupin_runtime.voice.envelope import ESTOPPED
from lupin_runtime.voice.listener_protocol import Kind
from tests.support.voice_rig import Rig, run, settle


def test_calls_are_carried_out_one_after_the_other() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "set_light", color="red")
        rig.call("b", "arm_save_pose", name="wave")
        await settle()
        assert [name for name, _ in rig.bridge.calls] == [graph.LEDS_SET.name]
        rig.bridge.calls[0][1](True, {"status": True})
        await settle()
        assert [name for name, _ in rig.bridge.calls] == [graph.LEDS_SET.name, graph.ARM_LIBRARY_SAVE_POSE.name]
        assert list(rig.responses()) == ["a"] and rig.responses()["a"]["ok"]

    run(test)


@pytest.mark.parametrize("stop", ["stop", "engage_estop", "nav_cancel", "arm_stop", "cancel"])
def test_stop_drops_the_commands_that_wait(stop: str) -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "set_light", color="red")
        rig.call("b", "drive", linear_x=0.2, duration_s=2)
        await settle()
        if stop == "cancel":
            rig.send(cancel=True)
        else:
            rig.call("c", stop)
        await settle()
        rig.bridge.calls[0][1](True, {"status": True})  # the answer that comes too late
        await settle()

    rig = run(test)
    responses = rig.responses()
    assert responses["a"] == responses["b"] == {"ok": False, "error": INTERRUPTED}
    assert 0.2 not in rig.bridge.log
    assert [what for what, refused in rig.bridge.recorded if refused == INTERRUPTED]


def test_command_that_waited_over_a_release_is_refused() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "set_light", color="red")
        rig.call("b", "drive", linear_x=0.2, duration_s=2)
        await settle()
        rig.bridge.era += 2  # somebody stops the robot, and releases it
        rig.bridge.calls[0][1](True, {"status": True})
        await settle()
        assert rig.responses()["b"] == {"ok": False, "error": OUTDATED}
        assert 0.2 not in rig.bridge.log

    run(test)


def test_calls_that_arrive_together_do_not_outdate_each_other() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "drive", linear_x=0.2, duration_s=2)
        rig.call("b", "set_light", color="red")
        await settle()
        rig.bridge.calls[0][1](True, {"status": True})
        await settle()
        assert rig.responses()["a"]["ok"] and rig.responses()["b"]["ok"]

    run(test)


def test_call_before_the_end_of_a_turn_takes_no_control() -> None:
    async def test(rig: Rig) -> None:
        rig.send(turn={"id": "2", "by": "speech", "ended": False})
        rig.call("a", "drive", linear_x=0.2, duration_s=2)
        await settle()
        assert not rig.responses()["a"]["ok"] and rig.bridge.authority.lease(0).holder is None

    run(test)


def test_burst_ends_when_the_robot_is_stopped() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "drive", linear_x=0.2, duration_s=2)
        await settle()
        rig.bridge.era += 1
        while rig.bridge.log[-1] != 0.0:
            await asyncio.sleep(0.01)
        assert [message["state"]["is_driving"] for message in rig.sent if "state" in message][-1] is False

    run(test)


def test_stop_forgets_what_was_read_back() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "nav_goto", x=1, y=1)
        await settle()
        rig.send(turn={"id": "2", "by": "speech"})
        rig.call("b", "stop")
        rig.call("c", "nav_goto", x=1, y=1, confirmation=rig.responses()["a"]["confirmation"])
        await settle()
        assert not rig.responses()["c"]["ok"] and graph.GOAL_POSE.name not in rig.bridge.log

    run(test)


def test_stop_does_not_drop_what_only_reads() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "arm_list_library")
        await settle()
        rig.call("b", "stop")
        await settle()
        rig.bridge.calls[0][1](True, {"json": '{"poses": [], "sequences": []}'})
        await settle()
        assert rig.responses()["a"] == {"ok": True, "poses": [], "sequences": []}

    run(test)


def test_stop_is_carried_out_while_another_call_waits() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "arm_list_library")
        rig.call("b", "engage_estop")
        await settle()
        assert rig.responses() == {"b": {"ok": True, "action": "engage_estop", "reason": "voice-agent"}}
        assert "stop of voice agent of phone-1" in rig.bridge.log

    run(test)


def test_closed_session_ends_its_burst_before_it_leaves() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "drive", linear_x=0.2, duration_s=2)
        await settle()
        rig.session.close()
        assert rig.bridge.log == ["join", 0.0, 0.2, 0.0, "leave"]

    run(test)


def test_cut_off_ends_the_burst() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "drive", linear_x=0.2, duration_s=2)
        await settle()
        for number in range(30):
            rig.call(f"b{number}", "rotate", angle_deg=number)
        assert rig.bridge.log[-1] == 0.0
        assert len([message for message in rig.sent if "cut_off" in message]) == 1

    run(test)


def test_failure_of_the_console_is_a_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise KeyError("a defect")

    async def test(rig: Rig) -> None:
        monkeypatch.setattr(rig.bridge, "publish", fail)
        rig.call("a", "nav_goto", x=1, y=1)
        await settle()
        token = rig.responses()["a"]["confirmation"]
        rig.send(turn={"id": "2", "by": "button"})
        rig.call("b", "nav_goto", x=1, y=1, confirmation=token)
        await settle()
        assert rig.responses()["b"] == {"ok": False, "error": "the console failed; see its log"}
        assert "KeyError" in rig.bridge.log[-1][1]

    run(test)


@pytest.mark.parametrize("topic", [graph.CMD_VEL_MANUAL.name, graph.GOAL_POSE.name])
def test_command_that_nobody_would_receive_fails(topic: str) -> None:
    async def test(rig: Rig) -> None:
        rig.bridge.unheard = {topic}
        rig.call("a", "drive", linear_x=0.2, duration_s=0.1)
        rig.call("b", "nav_goto", x=1, y=1)
        await settle()
        rig.send(turn={"id": "2", "by": "button"})
        rig.call("c", "nav_goto", x=1, y=1, confirmation=rig.responses()["b"]["confirmation"])
        await settle()
        failed = rig.responses()["a" if topic == graph.CMD_VEL_MANUAL.name else "c"]
        assert failed["ok"] is False and "so nothing would move" in failed["error"]
        assert topic not in rig.bridge.log and (0.2 in rig.bridge.log) is (topic == graph.GOAL_POSE.name)

    run(test)


def test_goal_that_became_outdated_is_no_success(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(rig: Rig) -> None:
        monkeypatch.setattr(rig.bridge, "publish", lambda client, *_, **__: client.status("error", "publish: outdated"))
        rig.call("a", "nav_goto", x=1, y=1)
        await settle()
        rig.send(turn={"id": "2", "by": "button"})
        rig.call("b", "nav_goto", x=1, y=1, confirmation=rig.responses()["a"]["confirmation"])
        await settle()
        assert rig.responses()["b"] == {"ok": False, "error": "publish: outdated"}

    run(test)


def test_state_is_sent_only_when_it_changes() -> None:
    async def test(rig: Rig) -> None:
        rig.send(alive=True)
        rig.send(turn={"id": "2", "by": "speech", "ended": False})
        rig.send(turn={"id": "2", "by": "speech"})
        states = [message["state"] for message in rig.sent if "state" in message]
        assert [(state["turn"], state["is_speaking"]) for state in states] == [(0, False), (1, False), (2, True), (2, False)]

    run(test)


@pytest.mark.parametrize(
    "text", ["", "nan", "[]", '{"call": {"id": ""}}', '{"call": {"id": "a\\n"}}', '{"closed": 1}', "[" * 9999, b"\xff"]
)
def test_malformed_message_is_answered(text: Any) -> None:
    async def test(rig: Rig) -> None:
        rig.session.handle(text)
        assert "error" in rig.sent[-1]

    run(test)


def test_stop_that_was_heard_engages_the_stop_at_once() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "drive", linear_x=0.2, duration_s=2)
        rig.call("b", "set_light", color="red")
        await settle()
        rig.listen("stops").stop_heard("please stop", "")
        await settle()
        assert "stop of voice agent of phone-1" in rig.bridge.log and rig.bridge.log[-1] == 0.0
        assert rig.responses()["b"] == {"ok": False, "error": INTERRUPTED}
        assert {"stop_heard": "please stop"} in rig.sent

    assert ("voice stop heard 'please stop'", "") in run(test).bridge.recorded


def test_stop_that_was_heard_forgets_what_was_read_back() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "nav_goto", x=1, y=1)
        await settle()
        rig.listen("stops").stop_heard("stop", "")
        rig.send(turn={"id": "2", "by": "speech"})
        rig.call("b", "nav_goto", x=1, y=1, confirmation=rig.responses()["a"]["confirmation"])
        await settle()
        assert not rig.responses()["b"]["ok"] and graph.GOAL_POSE.name not in rig.bridge.log

    run(test)


def test_stop_is_heard_before_the_first_turn_and_when_cut_off() -> None:
    async def test(rig: Rig) -> None:
        for number in range(30):
            rig.call(f"a{number}", "rotate", angle_deg=number)
        rig.listen("stops").stop_heard("halt", "")
        await settle()
        assert "stop of voice agent of phone-1" in rig.bridge.log

    run(test)


def test_sound_goes_to_the_listener_until_the_session_ends() -> None:
    async def test(rig: Rig) -> None:
        rig.listen("stops")
        rig.session.handle(bytes(1600))
        assert rig.listener.sent[-1] == (Kind.SOUND, bytes(1600))
        assert [each["state"]["listener"]["state"] for each in rig.sent if "state" in each][-1] == "ready"
        rig.session.close()
        assert rig.listener.user is None

    run(test)


def test_page_that_was_not_released_moves_nothing() -> None:
    async def test(rig: Rig) -> None:
        rig.send(closed=True)
        rig.call("a", "drive", linear_x=0.2, duration_s=2)
        rig.call("b", "speak", text="hello")
        await settle()
        assert rig.responses()["a"]["blocked"] and rig.responses()["b"]["ok"] and 0.2 not in rig.bridge.log
        rig.send(closed=False)
        rig.send(turn={"id": "2", "by": "text"})
        rig.call("c", "drive", linear_x=0.2, duration_s=2)
        await settle()
        assert rig.responses()["c"]["ok"]

    run(test)


def test_refusals_of_page_and_envelope_are_in_the_journal() -> None:
    async def test(rig: Rig) -> None:
        rig.send(refused={"name": "drive", "arguments": {"linear_x": 0.2}, "reason": "the page shows the past\n"})
        rig.send(refused={"name": "say", "reason": "the page shows the past"})
        rig.send(closed=True)
        rig.call("a", "drive", linear_x=0.2, duration_s=2)
        await settle()

    recorded = run(test).bridge.recorded
    assert ("voice drive {'linear_x': 0.2}", "by the page: the page shows the past") in recorded
    assert ("voice say {}", "by the page: the page shows the past") in recorded
    assert [refused for what, refused in recorded if "duration_s" in what] == [f"{ESTOPPED} ({PAGE_CLOSED})"]


@pytest.mark.parametrize("body", [None, [], {"name": "drive"}, {"name": 1, "reason": "no"}, {"name": "drive", "reason": {}}])
def test_malformed_refusal_of_a_page_is_not_journaled(body: Any) -> None:
    async def test(rig: Rig) -> None:
        rig.send(refused=body)

    rig = run(test)
    assert rig.bridge.recorded == [] and "refused must be" in rig.messages("error")[0]
