"""The arm is idle once nobody has used it for a while, and its use is named until then."""

from __future__ import annotations

import json
from typing import Any

import pytest

from lupin_runtime.arm.idle_watch import IDLE_S, LISTEN_S, SILENT_S, IdleWatch

S = 10**9
RESTS: dict[str, Any] = {"holder": "", "moving": False, "limp": False}


def reason_after(watch: IdleWatch, seconds: float, status: dict[str, Any], start_s: float = 0.0) -> str:
    """Repeat a status every 0.5 s, and return why the arm is not idle then."""
    said = ""
    for step in range(int(seconds * 2) + 1):
        now_ns = int((start_s + step / 2) * S)
        watch.status(json.dumps(status), now_ns)
        said = watch.reason(now_ns)
    return said


def test_arm_at_rest_is_idle_after_a_while() -> None:
    watch = IdleWatch(0)
    watch.mission("READY", 0)
    assert reason_after(watch, IDLE_S / 2, RESTS) == "it was in use just now"
    assert reason_after(watch, IDLE_S, RESTS, IDLE_S / 2) == ""


def test_arm_is_not_idle_before_a_mission_could_be_heard() -> None:
    watch = IdleWatch(0)
    assert reason_after(watch, LISTEN_S - 1.0, RESTS) == "a mission may be in progress whose state has not arrived yet"
    assert reason_after(watch, 1.0, RESTS, LISTEN_S - 1.0) == ""


@pytest.mark.parametrize(
    ("change", "expected"),
    [({"holder": "jogging"}, "it is reserved: jogging"), ({"moving": True}, "it moves"), ({"limp": True}, "it is limp")],
)
def test_use_is_named_and_its_end_begins_the_wait_anew(change: dict[str, Any], expected: str) -> None:
    watch = IdleWatch(0)
    reason_after(watch, 10.0, RESTS)
    assert reason_after(watch, 1.0, {**RESTS, **change}, 10.0) == expected
    assert reason_after(watch, IDLE_S / 2, RESTS, 11.5) == "it was in use just now"
    assert reason_after(watch, IDLE_S * 2, RESTS, 13.0) == ""


def test_library_and_mission_use_the_arm() -> None:
    watch = IdleWatch(0)
    reason_after(watch, 10.0, RESTS)
    watch.library('{"recording": true, "name": ""}', 10 * S)
    assert watch.reason(10 * S) == "the library is recording"
    watch.library('{"recording": false}', 10 * S)
    watch.mission("MONITORING", 10 * S)
    assert watch.reason(10 * S) == "a mission is MONITORING"
    watch.mission("DONE", 10 * S)
    assert watch.reason(10 * S) == "it was in use just now"


def test_mission_that_is_gone_does_not_use_the_arm() -> None:
    watch = IdleWatch(0)
    watch.mission("EXPLORING", 0)
    assert reason_after(watch, SILENT_S + IDLE_S + 1.0, RESTS) == ""


def test_arm_without_a_status_is_not_idle() -> None:
    watch = IdleWatch(0)
    assert "/lupin/arm/status is not received" in watch.reason(10 * S)
    reason_after(watch, 10.0, RESTS)
    assert "/lupin/arm/status is not received" in watch.reason(20 * S)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000])
def test_text_that_is_no_json_is_an_error(text: str) -> None:
    with pytest.raises(ValueError, match=r".+"):
        IdleWatch(0).status(text, 0)
