"""Round numbers are likelier than others, in every tool that has one."""

from __future__ import annotations

import pytest

from lupin_runtime.voice.grammar import parse
from lupin_runtime.voice.usual_numbers import rate_numbers
from lupin_runtime.voice.utterance import Call
from tests.support.spoken_commands import CONTEXT


@pytest.mark.parametrize(
    ("usual", "other"),
    [
        ("turn left ninety degrees", "turn left nineteen degrees"),
        ("turn right by thirty degrees", "turn right by thirteen degrees"),
        ("gripper forty percent", "gripper fourteen percent"),
        ("speed cap fifty percent", "speed cap fifteen percent"),
        ("go one metre back", "go 0.1 metres back"),
        ("turn left at twenty degrees per second for one second", "turn left at twenty degrees per second for 0.1 seconds"),
        ("go to x one y two", "go to x one y 2.3"),
    ],
)
def test_round_number_is_likelier(usual: str, other: str) -> None:
    calls = [parse(text, CONTEXT) for text in (usual, other)]
    ratings = [rate_numbers(call) for call in calls if isinstance(call, Call)]
    assert len(ratings) == 2 and ratings[0] == 0.0 > ratings[1]
