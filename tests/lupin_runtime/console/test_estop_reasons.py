"""Reading the reasons for a stop from the e-stop's status."""

from __future__ import annotations

import json

import pytest

from lupin_runtime.console.estop_reasons import read_reasons


def test_reasons_are_read_while_estop_is_engaged() -> None:
    assert read_reasons(json.dumps({"engaged": True, "reasons": ["the button is pressed"]})) == ("the button is pressed",)
    assert read_reasons(json.dumps({"engaged": False, "reasons": ["the button is pressed"]})) == ()


@pytest.mark.parametrize(
    "text", ["", "[]", '{"engaged": true}', '{"engaged": true, "reasons": 3}', "[" * 5000], ids=lambda text: text[:20]
)
def test_malformed_estop_status_has_no_reasons(text: str) -> None:
    assert read_reasons(text) == ()
