"""What may have been meant is carried out after a yes, with the checks of what is read back; a stop in between ends it."""

from __future__ import annotations

import pytest

from lupin_runtime.voice.questions import ASK
from tests.support.voice_rig import Rig, run, settle
from tests.support.voice_talk import Talk, replace_parts

DOUBTFUL_DRIVE = "drive forward for one second at 0.2 metres per second?"


@pytest.fixture(autouse=True)
def _parts(monkeypatch: pytest.MonkeyPatch) -> None:
    replace_parts(monkeypatch)


@pytest.mark.parametrize("how", ["yes", "button", "spoken"])
def test_doubtful_burst_is_driven_after_a_yes(how: str) -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        rig.listen("commands")
        asked = await talk.speak(DOUBTFUL_DRIVE)
        assert not asked["done"] and asked["read_back"].startswith("drive +0.2 m/s forward") and 0.2 not in rig.bridge.log
        reply = await (talk.type("yes") if how == "yes" else talk.press(True) if how == "button" else talk.speak("Yes."))
        assert reply["done"] and 0.2 in rig.bridge.log

    run(test)


@pytest.mark.parametrize("between", ["no", "stop", "closed", "era"])
def test_doubtful_burst_is_not_driven_after(between: str) -> None:
    async def test(rig: Rig) -> None:
        talk = Talk(rig)
        rig.listen("commands")
        await talk.speak(DOUBTFUL_DRIVE)
        if between == "no":
            await talk.speak("No.")
        elif between == "stop":
            await talk.type("stop")
        elif between == "closed":
            rig.send(closed=True)
        else:
            rig.bridge.era += 2  # somebody stops the robot, and releases it
        assert not (await talk.speak("Yes."))["done"] and 0.2 not in rig.bridge.log

    run(test)


def test_doubt_of_a_client_is_a_read_back_but_of_a_stop() -> None:
    async def test(rig: Rig) -> None:
        rig.call("a", "drive", linear_x=0.2, duration_s=1, confirmation=ASK)
        await settle()
        asked = rig.responses()["a"]
        assert asked["confirm"].startswith("drive +0.2 m/s forward") and 0.2 not in rig.bridge.log
        rig.send(turn={"id": "2", "by": "button"})
        rig.call("b", "drive", linear_x=0.2, duration_s=1, confirmation=asked["confirmation"])
        await settle()
        assert rig.responses()["b"]["ok"] and 0.2 in rig.bridge.log
        rig.call("c", "engage_estop", confirmation=ASK)
        await settle()
        assert rig.responses()["c"]["ok"] and "stop of voice agent of phone-1" in rig.bridge.log

    run(test)
