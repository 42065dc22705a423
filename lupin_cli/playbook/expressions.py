"""The conditions of playbooks: names, literals, comparisons, and/or/not. Nothing is ever executed.

expression  := conjunction ("or" conjunction)*
conjunction := negation ("and" negation)*
negation    := "not" negation | comparison
comparison  := value (("==" | "!=" | "<" | "<=" | ">" | ">=" | "in" | "not in") value)?
value       := number | 'text' | "text" | true | false | none | name("."name)* | "[" values "]" | "(" expression ")"

Values are replaced by placeholders first, since Python's literals and keywords differ from ours. Python's own parser then reads
the rest, and only the nodes in `_NODES` are accepted and evaluated.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

_TOKEN = re.compile(
    r"""\s*(?:
        (?P<number>-?\d+(?:\.\d+)?(?![\w.]))
      | (?P<text>'[^']*'|"[^"]*")
      | (?P<operator>==|!=|<=|>=|<|>|\(|\)|\[|\]|,)
      | (?P<name>[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z_][A-Za-z0-9_]*)*)
    )""",
    re.VERBOSE,
)
_LITERALS: dict[str, Any] = {"true": True, "false": False, "none": None}
_KEYWORDS = ("and", "or", "not", "in")
_COMPARISONS = ("==", "!=", "<", "<=", ">", ">=", "in")
_MAX_NESTING = 40  # of brackets

_NODES = (ast.BoolOp, ast.And, ast.Or, ast.UnaryOp, ast.Not, ast.Compare, ast.List, ast.Name, ast.Load)


class ExpressionError(ValueError):
    """An expression is invalid or cannot be evaluated. `column` counts characters from the start of its text."""

    def __init__(self, message: str, column: int) -> None:
        super().__init__(message)
        self.column = column


@dataclass(frozen=True)
class Name:
    """A variable, or a value of a step's result: `server.changed`."""

    path: tuple[str, ...]
    column: int

    def evaluate(self, scope: Mapping[str, Any]) -> Any:
        """Return the value in `scope`; raises ExpressionError if the first part has none. An unknown second part is None."""
        if self.path[0] not in scope:
            raise ExpressionError(f"{self.path[0]!r} has no value yet", self.column)
        value: Any = scope[self.path[0]]
        for part in self.path[1:]:
            value = value.get(part) if isinstance(value, Mapping) else None
        return value


@dataclass(frozen=True)
class _Token:
    kind: str  # number, text, operator, name; a keyword counts as an operator
    word: str
    column: int

    @property
    def is_value(self) -> bool:
        return self.kind != "operator"

    def value(self) -> Any:
        """Return a literal's value or a Name; raises ExpressionError for a number that is too long."""
        if self.kind == "text":
            return self.word[1:-1]
        if self.kind == "name":
            return _LITERALS[self.word] if self.word in _LITERALS else Name(tuple(self.word.split(".")), self.column)
        try:
            return float(self.word) if "." in self.word else int(self.word)
        except ValueError as error:  # Python limits the digits of an integer
            raise ExpressionError("the number has too many digits", self.column) from error


@dataclass(frozen=True)
class Expression:
    """A parsed condition."""

    text: str
    tree: ast.expr
    values: Mapping[str, Any]  # literals and Names, by the placeholder in the tree

    def evaluate(self, scope: Mapping[str, Any]) -> Any:
        """Return its value; raises ExpressionError for a name without a value, or values that cannot be compared."""
        return self._evaluate(self.tree, scope)

    def names(self) -> Iterator[Name]:
        """Yield every name in it, to check them before anything runs."""
        yield from (value for value in self.values.values() if isinstance(value, Name))

    def _evaluate(self, node: ast.expr, scope: Mapping[str, Any]) -> Any:
        if isinstance(node, ast.Name):
            value = self.values[node.id]
            return value.evaluate(scope) if isinstance(value, Name) else value
        if isinstance(node, ast.List):
            return [self._evaluate(item, scope) for item in node.elts]
        if isinstance(node, ast.UnaryOp):
            return not self._evaluate(node.operand, scope)
        if isinstance(node, ast.BoolOp):
            decide = all if isinstance(node.op, ast.And) else any
            return decide(bool(self._evaluate(part, scope)) for part in node.values)
        assert isinstance(node, ast.Compare)
        left, right = self._evaluate(node.left, scope), self._evaluate(node.comparators[0], scope)
        operator, compare = _COMPARE[type(node.ops[0])]
        try:
            return bool(compare(left, right))
        except TypeError as error:
            raise ExpressionError(f"{left!r} {operator} {right!r} cannot be compared", 0) from error


def _less(left: Any, right: Any) -> bool:
    # None is neither less nor more than anything: if a probe found no number, no comparison with it holds.
    return left is not None and right is not None and left < right


_COMPARE: dict[type[ast.cmpop], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Eq: ("==", lambda left, right: left == right),
    ast.NotEq: ("!=", lambda left, right: left != right),
    ast.Lt: ("<", _less),
    ast.Gt: (">", lambda left, right: _less(right, left)),
    ast.LtE: ("<=", lambda left, right: _less(left, right) or (left is not None and left == right)),
    ast.GtE: (">=", lambda left, right: _less(right, left) or (left is not None and left == right)),
    ast.In: ("in", lambda left, right: right is not None and left in right),
    ast.NotIn: ("not in", lambda left, right: right is None or left not in right),
}


def parse(text: str) -> Expression:
    """Parse an expression; raises ExpressionError at the first invalid word."""
    tokens = list(_tokens(text))
    _check_order(tokens, len(text.rstrip()))
    values = {f"v{n}": token.value() for n, token in enumerate(tokens) if token.is_value}
    source = " ".join(f"v{n}" if token.is_value else token.word for n, token in enumerate(tokens))
    try:
        tree = ast.parse(_without_double_negation(source), mode="eval").body
    except (SyntaxError, RecursionError, MemoryError) as error:
        raise ExpressionError(f"is not a condition: {error}", 0) from error
    for node in ast.walk(tree):
        chained = isinstance(node, ast.Compare) and len(node.ops) != 1
        if chained or not isinstance(node, (*_NODES, *_COMPARE)):
            raise ExpressionError(f"is not a condition: {type(node).__name__} is not allowed", 0)
    return Expression(text, tree, values)


def _without_double_negation(source: str) -> str:
    return re.sub(r"\bnot not (?!in\b)", "", source)


def _tokens(text: str) -> Iterator[_Token]:
    column = 0
    while text[column:].strip():
        match = _TOKEN.match(text, column)
        if match is None:
            column += len(text[column:]) - len(text[column:].lstrip())
            hint = "; equality is written ==" if text[column] == "=" else ""
            raise ExpressionError(f"{text[column]!r} is not part of an expression{hint}", column)
        kind = str(match.lastgroup)
        word = match.group(kind)
        yield _Token("operator" if word in _KEYWORDS else kind, word, match.start(kind))
        column = match.end()


def _check_order(tokens: list[_Token], end: int) -> None:
    """Raise ExpressionError at the first misplaced token, with a message in terms of this language instead of Python."""
    brackets: list[tuple[str, bool]] = []  # the open ones, each with whether a comparison was read before it
    value_next, may_negate, compared = True, True, False
    words = [token.word if not token.is_value else "" for token in tokens] + [""]
    for index, token in enumerate(tokens):
        word = words[index]
        if value_next:
            if word in ("(", "["):
                brackets.append((word, compared))
                may_negate, compared = word == "(", False
                if len(brackets) >= _MAX_NESTING:
                    raise ExpressionError("is nested too deeply", token.column + 1)
            elif word == "]" and index and words[index - 1] == "[":
                compared, value_next = brackets.pop()[1], False
            elif token.is_value:
                value_next = False
            elif word != "not" or not may_negate:
                raise ExpressionError(f"expected a value, found {token.word!r}", token.column)
            continue
        bracket = brackets[-1][0] if brackets else ""
        if bracket == "[" and word not in (",", "]"):
            raise ExpressionError("expected ',' or ']'", token.column)
        if (bracket, word) in (("(", ")"), ("[", "]")):
            compared = brackets.pop()[1]
        elif bracket == "[" and word == ",":
            value_next, may_negate = True, False
        elif word in ("and", "or"):
            value_next, may_negate, compared = True, True, False
        elif word in _COMPARISONS and not compared:
            value_next, may_negate, compared = True, False, True
        elif word == "not" and not compared:
            following = tokens[index + 1].column if index + 1 < len(tokens) else end
            if words[index + 1] != "in":
                raise ExpressionError("expected 'in' after 'not' here", following)
        else:
            what = "expected ')'" if bracket else f"expected 'and', 'or' or the end, found {token.word!r}"
            raise ExpressionError(what, token.column)
    if value_next:
        raise ExpressionError("expected a value, found the end", end)
    if brackets:
        raise ExpressionError("expected ')'" if brackets[-1][0] == "(" else "expected ',' or ']'", end)
