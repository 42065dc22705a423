"""Conditions: what they mean, what they refuse, and that they never do more than look."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.runbook.expressions import ExpressionError, parse
from lupin_cli.runbook.templates import VARIABLE_TYPES, coerce, from_command_line, read_template, resolve

SCOPE: dict[str, Any] = {"n": 3, "word": "up", "none_yet": None, "list": ["a", "b"], "step": {"changed": True, "status": 0}}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("n == 3", True),
        ("n != 3 or word == 'up'", True),
        ("n > 2 and n <= 3", True),
        ("not step.changed", False),
        ("not not step.changed", True),
        ("not (n == 3 and word == 'down')", True),
        ("step.status == 0 and not false", True),
        ("word in ['up', 'down']", True),
        ("'c' not in list", True),
        ("'c' not in none_yet", True),
        ("n", 3),
        ("step.missing", None),
        ("step.missing > 3", False),
        ("3 > step.missing", False),
        ("-1.5 < n", True),
        ("none == none_yet", True),
        ("true or missing", True),
        ("false and missing", False),
    ],
)
def test_an_expression_means_what_it_says(text: str, value: Any) -> None:
    assert parse(text).evaluate(SCOPE) == value


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("", 0, "found the end"),
        ("n ==", 4, "found the end"),
        ("n = 3", 2, "equality is written =="),
        ("n 3", 2, "expected 'and', 'or' or the end"),
        ("(n", 2, "expected ')'"),
        ("[1 2]", 3, "expected ',' or ']'"),
        ("n not 3", 6, "expected 'in'"),
        ("__import__('os')", 10, "expected 'and'"),
        ("n and", 5, "found the end"),
        ("n; n", 1, "';' is not part"),
        ("(" * 100 + "n", 40, "too deeply"),
    ],
)
def test_what_is_no_expression_is_refused_at_its_column(text: str, column: int, words: str) -> None:
    with pytest.raises(ExpressionError) as refused:
        parse(text)
    assert (refused.value.column, words in str(refused.value)) == (column, True), str(refused.value)


@given(st.text(alphabet="()[]<>=!.,'\" abnortinf0123456789_{}", max_size=40))
def test_any_text_is_an_expression_or_refused(text: str) -> None:
    try:
        parse(text)
    except ExpressionError as error:
        assert 0 <= error.column <= len(text)


truths = st.sampled_from([True, False])


@given(truths, truths, truths)
def test_and_binds_closer_than_or_and_not_closest(a: bool, b: bool, c: bool) -> None:
    assert parse("a or not b and c").evaluate({"a": a, "b": b, "c": c}) == (a or (not b and c))


def test_names_without_a_value_and_things_that_do_not_compare_are_errors() -> None:
    with pytest.raises(ExpressionError, match="'later' has no value yet"):
        parse("later.changed").evaluate(SCOPE)
    with pytest.raises(ExpressionError, match="cannot be compared"):
        parse("n < word").evaluate(SCOPE)


def test_a_template_of_one_hole_keeps_the_type_and_others_are_text() -> None:
    assert resolve(read_template("{{ n }}"), SCOPE) == 3
    assert resolve(read_template("port {{ n }}/{{word}}{{ none_yet }}"), SCOPE) == "port 3/up"
    assert resolve({"a": [read_template("{{ step.changed }}")]}, SCOPE) == {"a": [True]}
    assert read_template("plain") == "plain"


def test_types_take_what_fits_and_name_what_they_want() -> None:
    assert coerce(3, float) == 3.0 and isinstance(coerce(3, float), float)
    assert coerce("a", tuple[str, ...]) == ("a",)
    assert coerce(None, str | None) is None
    for value, hint, words in (
        (True, int, "whole number"),
        ("3", int, "whole number"),
        (3, str, "quotes"),
        (1, bool, "true or false"),
    ):
        with pytest.raises(ValueError, match=words):
            coerce(value, hint)
    with pytest.raises(ValueError, match="IPv4"):
        VARIABLE_TYPES["address"]("robot")


def test_the_text_of_an_option_becomes_the_variables_type() -> None:
    assert from_command_line("3", "integer") == 3
    assert from_command_line("no", "truth") is False
    assert from_command_line("a,b", "list") == ["a", "b"]
    with pytest.raises(ValueError, match="whole number"):
        from_command_line("three", "integer")
