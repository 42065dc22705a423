"""Numbers as people say them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.voice.dutch import DUTCH
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.language import Language
from lupin_runtime.voice.spoken_numbers import parse_numbers
from lupin_runtime.voice.tokens import clean_text, tokenize

ONES = [word for word, value in ENGLISH.numbers.small.items() if value < 20]
TENS = [word for word, value in ENGLISH.numbers.small.items() if value >= 20]


def whole(text: str, language: Language = ENGLISH) -> set[float]:
    """What the whole text can mean as a number."""
    words = tuple(token.text for token in tokenize(text))
    return {found.value for found in parse_numbers(words, 0, language.numbers) if found.end == len(words)}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("zero", 0), ("seven", 7), ("nineteen", 19), ("forty", 40), ("forty five", 45), ("forty-five", 45),
        ("ninety nine", 99),
        ("hundred", 100), ("one hundred", 100), ("a hundred", 100), ("one hundred and eighty", 180),
        ("two hundred twelve", 212),
        ("100 and 80", 180),
        ("half", 0.5), ("half a", 0.5), ("a quarter", 0.25), ("three quarters of a", 0.75), ("one and a half", 1.5),
        ("2 and a half", 2.5), ("point five", 0.5), ("zero point two five", 0.25), ("one point five", 1.5),
        ("two point 75", 2.75),
        ("0.5", 0.5), ("0,5", 0.5), (".5", 0.5), ("12", 12), ("-3", -3), ("minus two point five", -2.5), ("plus 4", 4),
        ("won", 1), ("ate", 8), ("to", 2),
    ],
)  # fmt: skip
def test_english_number_has_its_value(text: str, value: float) -> None:
    assert whole(text) == {value}


@pytest.mark.parametrize(
    "text", ["", "sink", "two three", "forty fifty", "minus minus two", "point", "1,000", "a hundred fifty x"]
)
def test_other_words_are_no_number(text: str) -> None:
    assert whole(text) == set()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("een", 1),
        ("vijfentwintig", 25),
        ("tweeëndertig", 32),
        ("tweehonderdvijftig", 250),
        ("anderhalve", 1.5),
        ("min drie", -3),
        ("nul komma twee", 0.2),
        ("0,2", 0.2),
        ("twee en een halve", 2.5),
    ],
)
def test_dutch_number_has_its_value(text: str, value: float) -> None:
    assert whole(text, DUTCH) == {value}


@given(st.integers(0, 999))
def test_every_number_below_a_thousand_can_be_said(number: int) -> None:
    hundreds, below = divmod(number, 100)
    tens, ones = divmod(below, 10)
    words = [ONES[below]] if below < 20 else [TENS[tens - 2], *([ONES[ones]] if ones else [])]
    if hundreds:
        words = [ONES[hundreds], "hundred", *(words if below else [])]
    assert whole(" ".join(words)) == {float(number)}


@given(st.floats(-1e4, 1e4))
def test_written_number_has_its_value(number: float) -> None:
    assert whole(f"{number:.3f}") == {float(f"{number:.3f}")}


@pytest.mark.parametrize(
    ("text", "tokens"),
    [
        ("tag-5 -5m", "tag 5 -5 m"),
        ("x2, y-1", "x 2 y -1"),
        ("x2y-1", "x 2 y -1"),
        ("x=-2 (+1)", "x -2 +1"),
        ("y - 1.5", "y minus 1.5"),
        ("twenty-five", "twenty five"),
        ("2-3", "2 3"),
        ("90° 5% m/s", "90 degrees 5 percent m per s"),
        ("−3 don’t E-Stop", "-3 don't e-stop"),
    ],
)
def test_text_is_split_without_losing_a_sign(text: str, tokens: str) -> None:
    assert " ".join(token.text for token in tokenize(clean_text(text))) == tokens
