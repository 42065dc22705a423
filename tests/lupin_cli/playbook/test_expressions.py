"""Conditions: their values, their errors, and that nothing but names and literals is ever evaluated."""

from __future__ import annotations

import ast
import contextlib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.playbook.argument_types import VARIABLE_TYPES, coerce, from_command_line
from lupin_cli.playbook.expressions import ExpressionError, parse
from lupin_cli.playbook.templates import read_template, resolve

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
def test_expression_evaluates(text: str, value: Any) -> None:
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
def test_invalid_expression_is_refused_at_its_column(text: str, column: int, words: str) -> None:
    with pytest.raises(ExpressionError) as refused:
        parse(text)
    assert (refused.value.column, words in str(refused.value)) == (column, True), str(refused.value)


@given(st.text(alphabet="()[]<>=!.,'\" abnortinf0123456789_{}", max_size=40))
def test_any_text_is_parsed_or_refused_at_a_column(text: str) -> None:
    try:
        parse(text)
    except ExpressionError as error:
        assert 0 <= error.column <= len(text)


WORDS = "n word step.changed none_yet later true none 3 -1.5 'up' ( ) [ ] , and or not in == != < >="
PYTHON_WORDS = "lambda if else is await import __class__ : = + * . { }"
words = st.sampled_from(f"{WORDS} {PYTHON_WORDS}".split())


@given(st.lists(words, max_size=12).map(" ".join) | st.text(max_size=40))
def test_only_allowed_nodes_are_evaluated(text: str) -> None:
    try:
        expression = parse(text)
    except ExpressionError as error:
        assert 0 <= error.column <= len(text)
        return
    allowed = (ast.BoolOp, ast.boolop, ast.UnaryOp, ast.Not, ast.Compare, ast.cmpop, ast.List, ast.Name, ast.Load)
    for node in ast.walk(expression.tree):
        assert isinstance(node, allowed) and not isinstance(node, (ast.Is, ast.IsNot))
        assert not isinstance(node, ast.Name) or node.id in expression.values
    with contextlib.suppress(ExpressionError):
        expression.evaluate(SCOPE)


OTHER_PYTHON = ["n < 3 < 4", "n[0]", "n(3)", "[n, ]", "()", "not in n", "[not n]", "n == not n", "f'{n}'", "n if n"]
KEYWORDS = ["class == 1", "lambda.is and None", "'a\\n' == 'a\\n'", "import in ['import']"]


@pytest.mark.parametrize("text", OTHER_PYTHON)
def test_other_python_is_refused(text: str) -> None:
    with pytest.raises(ExpressionError):
        parse(text)


@pytest.mark.parametrize("text", KEYWORDS)
def test_python_keywords_are_names_and_text_has_no_escapes(text: str) -> None:
    assert parse(text).evaluate({"class": 1, "lambda": {"is": 1}, "None": 1, "import": "import"}) is True


def test_deep_and_long_expressions_are_refused_not_crashed() -> None:
    assert parse("not " * 10_000 + "n").evaluate(SCOPE) == 3
    assert parse(" and ".join(["n"] * 5_000)).evaluate(SCOPE) is True
    for text in ("9" * 5_000, "[" * 500, "(" * 5_000):
        with pytest.raises(ExpressionError):
            parse(text)


truths = st.sampled_from([True, False])


@given(truths, truths, truths)
def test_operator_precedence_is_that_of_python(a: bool, b: bool, c: bool) -> None:
    assert parse("a or not b and c").evaluate({"a": a, "b": b, "c": c}) == (a or (not b and c))


def test_missing_values_and_unlike_types_are_errors() -> None:
    with pytest.raises(ExpressionError, match="'later' has no value yet"):
        parse("later.changed").evaluate(SCOPE)
    with pytest.raises(ExpressionError, match="cannot be compared"):
        parse("n < word").evaluate(SCOPE)


def test_template_of_one_expression_keeps_the_type() -> None:
    assert resolve(read_template("{{ n }}"), SCOPE) == 3
    assert resolve(read_template("port {{ n }}/{{word}}{{ none_yet }}"), SCOPE) == "port 3/up"
    assert resolve({"a": [read_template("{{ step.changed }}")]}, SCOPE) == {"a": [True]}
    assert read_template("plain") == "plain"


def test_coerce_accepts_lossless_values_only() -> None:
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


def test_option_text_becomes_the_variables_type() -> None:
    assert from_command_line("3", "integer") == 3
    assert from_command_line("no", "truth") is False
    assert from_command_line("a,b", "list") == ["a", "b"]
    with pytest.raises(ValueError, match="whole number"):
        from_command_line("three", "integer")
