"""The conditions of playbooks: names, literals, comparisons, and/or/not. A tree that is walked, nothing that is executed.

expression  := conjunction ("or" conjunction)*
conjunction := negation ("and" negation)*
negation    := "not" negation | comparison
comparison  := value (("==" | "!=" | "<" | "<=" | ">" | ">=" | "in" | "not in") value)?
value       := number | 'text' | "text" | true | false | none | name("."name)* | "[" values "]" | "(" expression ")"
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from lupin_cli.quick_dataclass import dataclass

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
_WORDS = {"and", "or", "not", "in", *_LITERALS}
_DEEPEST = 40


class ExpressionError(ValueError):
    """What is wrong with an expression, and how far into its text, in characters."""

    def __init__(self, message: str, column: int) -> None:
        super().__init__(message)
        self.column = column


@dataclass(frozen=True)
class Literal:
    value: Any

    def evaluate(self, scope: Mapping[str, Any]) -> Any:
        return self.value


@dataclass(frozen=True)
class Name:
    """A variable, or a value of a step's result: `server.changed`."""

    path: tuple[str, ...]
    column: int

    def evaluate(self, scope: Mapping[str, Any]) -> Any:
        if self.path[0] not in scope:
            raise ExpressionError(f"{self.path[0]!r} has no value yet", self.column)
        value: Any = scope[self.path[0]]
        for part in self.path[1:]:
            value = value.get(part) if isinstance(value, Mapping) else None
        return value


@dataclass(frozen=True)
class Sequence:
    items: tuple[Any, ...]

    def evaluate(self, scope: Mapping[str, Any]) -> Any:
        return [item.evaluate(scope) for item in self.items]


@dataclass(frozen=True)
class Not:
    of: Any

    def evaluate(self, scope: Mapping[str, Any]) -> bool:
        return not self.of.evaluate(scope)


@dataclass(frozen=True)
class Junction:
    """and: all of them; or: any of them. The rest isn't looked at once it is decided."""

    all_of: bool
    parts: tuple[Any, ...]

    def evaluate(self, scope: Mapping[str, Any]) -> bool:
        decide = all if self.all_of else any
        return decide(bool(part.evaluate(scope)) for part in self.parts)


@dataclass(frozen=True)
class Comparison:
    operator: str
    left: Any
    right: Any
    column: int

    def evaluate(self, scope: Mapping[str, Any]) -> bool:
        left, right = self.left.evaluate(scope), self.right.evaluate(scope)
        try:
            return bool(_COMPARE[self.operator](left, right))
        except TypeError as error:
            raise ExpressionError(f"{left!r} {self.operator} {right!r} cannot be compared", self.column) from error


def _less(left: Any, right: Any) -> bool:
    # Nothing is neither less nor more than anything: a probe that could not tell decides nothing.
    return left is not None and right is not None and left < right


_COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "==": lambda left, right: left == right,
    "!=": lambda left, right: left != right,
    "<": _less,
    ">": lambda left, right: _less(right, left),
    "<=": lambda left, right: _less(left, right) or (left is not None and left == right),
    ">=": lambda left, right: _less(right, left) or (left is not None and left == right),
    "in": lambda left, right: right is not None and left in right,
    "not in": lambda left, right: right is None or left not in right,
}


@dataclass(frozen=True)
class Expression:
    """A parsed condition."""

    text: str
    tree: Any

    def evaluate(self, scope: Mapping[str, Any]) -> Any:
        """Its value; raises ExpressionError for a name without a value, or values that cannot be compared."""
        return self.tree.evaluate(scope)

    def names(self) -> Iterator[Name]:
        """Every name in it, for checking before anything runs."""
        waiting = [self.tree]
        while waiting:
            node = waiting.pop()
            if isinstance(node, Name):
                yield node
            elif isinstance(node, Not):
                waiting.append(node.of)
            elif isinstance(node, Comparison):
                waiting += [node.left, node.right]
            elif isinstance(node, Junction):
                waiting += node.parts
            elif isinstance(node, Sequence):
                waiting += node.items


def parse(text: str) -> Expression:
    """Read an expression; raises ExpressionError at the first word that doesn't fit."""
    return Expression(text, _Parser(text).whole())


class _Parser:
    def __init__(self, text: str) -> None:
        self._tokens = list(_tokens(text))
        self._at = 0
        self._depth = 0
        self._end = len(text.rstrip())

    def whole(self) -> Any:
        tree = self._junction()
        if self._at < len(self._tokens):
            _, word, column = self._tokens[self._at]
            hint = "; equality is written ==" if word == "=" else ""
            raise ExpressionError(f"expected 'and', 'or' or the end, found {word!r}{hint}", column)
        return tree

    def _peek(self) -> str:
        if self._at >= len(self._tokens):
            return ""
        kind, word, _ = self._tokens[self._at]
        return "" if kind == "text" else word

    def _take(self, *words: str) -> bool:
        if self._peek() in words:
            self._at += 1
            return True
        return False

    def _column(self) -> int:
        return self._tokens[self._at][2] if self._at < len(self._tokens) else self._end

    def _junction(self) -> Any:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ExpressionError("is nested too deeply", self._column())
        parts = [self._conjunction()]
        while self._take("or"):
            parts.append(self._conjunction())
        self._depth -= 1
        return parts[0] if len(parts) == 1 else Junction(False, tuple(parts))

    def _conjunction(self) -> Any:
        parts = [self._negation()]
        while self._take("and"):
            parts.append(self._negation())
        return parts[0] if len(parts) == 1 else Junction(True, tuple(parts))

    def _negation(self) -> Any:
        negated = False
        while self._take("not"):
            negated = not negated
        tree = self._comparison()
        return Not(tree) if negated else tree

    def _comparison(self) -> Any:
        left = self._value()
        column, word = self._column(), self._peek()
        if word == "not":
            self._at += 1
            if not self._take("in"):
                raise ExpressionError("expected 'in' after 'not' here", self._column())
            return Comparison("not in", left, self._value(), column)
        if word in _COMPARE:
            self._at += 1
            return Comparison(word, left, self._value(), column)
        return left

    def _value(self) -> Any:
        if self._at >= len(self._tokens):
            raise ExpressionError("expected a value, found the end", self._end)
        kind, word, column = self._tokens[self._at]
        self._at += 1
        if kind == "number":
            return Literal(float(word) if "." in word else int(word))
        if kind == "text":
            return Literal(word[1:-1])
        if kind == "name" and word in _LITERALS:
            return Literal(_LITERALS[word])
        if kind == "name" and word not in _WORDS:
            return Name(tuple(word.split(".")), column)
        if word == "(":
            tree = self._junction()
            if not self._take(")"):
                raise ExpressionError("expected ')'", self._column())
            return tree
        if word == "[":
            items: list[Any] = []
            while not self._take("]"):
                if items and not self._take(","):
                    raise ExpressionError("expected ',' or ']'", self._column())
                items.append(self._value())
            return Sequence(tuple(items))
        raise ExpressionError(f"expected a value, found {word!r}", column)


def _tokens(text: str) -> Iterator[tuple[str, str, int]]:
    at = 0
    while text[at:].strip():
        match = _TOKEN.match(text, at)
        if match is None:
            at += len(text[at:]) - len(text[at:].lstrip())
            hint = "; equality is written ==" if text[at] == "=" else ""
            raise ExpressionError(f"{text[at]!r} is not part of an expression{hint}", at)
        kind = str(match.lastgroup)
        yield kind, match.group(kind), match.start(kind)
        at = match.end()
