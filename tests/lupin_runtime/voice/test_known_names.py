"""Names are found by letters and by sound, with a margin."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.known_names import FoundName, NoName, find_name

DIGITS = ENGLISH.numbers.small
NAMES = ("home", "sink", "Tag_5", "tag 6", "charging station", "watering can", "tomatoes")


@pytest.mark.parametrize(
    ("heard", "name"),
    [
        ("sink", "sink"),
        ("SINK", "sink"),
        ("sync", "sink"),
        ("zinc", "sink"),
        ("tag five", "Tag_5"),
        ("tag5", "Tag_5"),
        ("chargingstation", "charging station"),
        ("charging stasion", "charging station"),
        ("tomatos", "tomatoes"),
    ],
)
def test_name_is_found(heard: str, name: str) -> None:
    found = find_name(heard, NAMES, DIGITS)
    assert isinstance(found, FoundName) and found.name == name


@pytest.mark.parametrize(
    "heard", ["pink", "sinks", "tag", "tag 7", "tag 56", "station", "charging", "charging station she", "", "five"]
)
def test_other_words_are_no_name(heard: str) -> None:
    assert find_name(heard, NAMES, DIGITS) == NoName(heard)


def test_names_that_are_equally_near_are_candidates() -> None:
    assert find_name("tomatou", ("tomatoa", "tomatoi"), DIGITS) == NoName("tomatou", ("tomatoa", "tomatoi"))
    assert find_name("tag five", ("tag 5", "tag_5"), DIGITS) == NoName("tag five", ("tag 5", "tag_5"))


def test_exact_name_wins_over_one_that_sounds_alike() -> None:
    assert find_name("sync", ("sink", "sync"), DIGITS) == FoundName("sync", 0)


@given(st.lists(st.text("abcdefghij ", min_size=1, max_size=12).filter(str.strip), unique=True, max_size=8))
def test_every_distinct_name_finds_itself(names: list[str]) -> None:
    distinct = {"".join(name.split()): name for name in names}
    for name in distinct.values():
        assert find_name(name, distinct.values(), DIGITS) == FoundName(name, 0)
