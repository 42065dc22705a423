"""The arguments of tools: their types and ranges, and the check of what a model sends."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

MAX_NAME = 64
MAX_TEXT = 1000
# A number beyond it is a mistake for every argument, also for one that is limited to its range.
MAX_MAGNITUDE = 1e6

Values = Mapping[str, Any]


class Kind(enum.Enum):
    """The type of an argument; the value is its JSON type. CHOICES is a list of some of the choices."""

    NUMBER = "number"
    CHOICE = "string"
    NAME = "name"
    TEXT = "text"
    CHOICES = "array"


class Outside(enum.Enum):
    """What happens to a number outside its range: it is refused, or the end of the range is used."""

    REFUSE = "refuse"
    LIMIT = "limit"


class BadArgument(ValueError):
    """Arguments that do not fit the tool; the text has the argument's name, what is expected, and what was found."""


@dataclass(frozen=True)
class Argument:
    """One argument. Numbers have a range, in `unit`; `default` is used where the argument is absent.

    `range_text` describes the range in place of `low` and `high`, where a setting gives them. With a `fallback`, a value that
    is not a finite number is replaced by it, also if the argument is required.
    """

    name: str
    kind: Kind
    description: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    outside: Outside = Outside.REFUSE
    range_text: str = ""
    choices: tuple[str, ...] = ()
    required: bool = False
    default: Any = None
    fallback: float | None = None

    @property
    def expected(self) -> str:
        """What a value must be, in words."""
        if self.kind is Kind.NUMBER:
            span = self.range_text or f"{self.low:g} to {self.high:g}"
            return f"a number from {span}{f' {self.unit}' if self.unit else ''}"
        if self.kind is Kind.CHOICE:
            return f"one of {', '.join(self.choices)}"
        if self.kind is Kind.CHOICES:
            return f"a list of {', '.join(self.choices)}"
        if self.kind is Kind.NAME:
            return f"1 to {MAX_NAME} printable characters"
        return f"text of 1 to {MAX_TEXT} characters"

    def check(self, value: Any) -> Any:
        """Return the value as the tool uses it. Raises BadArgument."""
        if self.kind is Kind.NUMBER:
            return self._check_number(value)
        if self.kind is Kind.CHOICES:
            return self._check_choices(value)
        if not isinstance(value, str):
            raise self._unfit(value)
        text = value.strip()
        if self.kind is Kind.CHOICE:
            return self._check_choice(text)
        longest = MAX_NAME if self.kind is Kind.NAME else MAX_TEXT
        is_clean = text.isprintable() if self.kind is Kind.NAME else text.replace("\n", " ").isprintable()
        if not text or len(text) > longest or not is_clean:
            raise self._unfit(value)
        return text

    def _check_number(self, value: Any) -> float:
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        # Compared before it is converted: an integer may be too large for a float.
        if not is_number or not -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE:
            if self.fallback is not None:
                return self.fallback
            raise self._unfit(value)
        number = float(value)
        if self.low <= number <= self.high:
            return number
        if self.outside is Outside.LIMIT:
            return min(self.high, max(self.low, number))
        raise self._unfit(value)

    def _check_choice(self, text: str) -> str:
        found = next((choice for choice in self.choices if choice == text.lower()), None)
        if found is None:
            raise self._unfit(text)
        return found

    def _check_choices(self, value: Any) -> tuple[str, ...]:
        if not isinstance(value, list) or not value or not all(isinstance(each, str) for each in value[:100]):
            raise self._unfit(value)
        chosen = {self._check_choice(each.strip()) for each in value[:100]}
        return tuple(choice for choice in self.choices if choice in chosen)

    def _unfit(self, value: Any) -> BadArgument:
        return BadArgument(f"{self.name} must be {self.expected}, not {shown(value)}")

    def schema(self) -> dict[str, Any]:
        """Return the JSON schema, with what it cannot express in the description."""
        unit = f" in {self.unit}" if self.unit else ""
        schema: dict[str, Any] = {"type": "string", "description": f"{self.description}{unit}"}
        if self.kind is Kind.NUMBER:
            schema["type"] = "number"
            if self.range_text:
                schema["description"] += f", from {self.range_text}"
            else:
                schema.update(minimum=self.low, maximum=self.high)
        elif self.kind is Kind.CHOICE:
            schema["enum"] = list(self.choices)
        elif self.kind is Kind.CHOICES:
            schema.update(type="array", items={"type": "string", "enum": list(self.choices)})
        return schema


def check_arguments(arguments: tuple[Argument, ...], values: Any) -> dict[str, Any]:
    """Return the checked values of a call, with defaults; arguments that are absent or null and have none are left out.

    Raises BadArgument.
    """
    if not isinstance(values, dict):
        raise BadArgument(f"arguments must be an object, not {shown(values)}")
    known = {argument.name for argument in arguments}
    if unknown := [name for name in values if name not in known]:
        raise BadArgument(f"unknown argument {shown(unknown[0])}; expected {', '.join(sorted(known)) or 'none'}")
    checked: dict[str, Any] = {}
    for argument in arguments:
        value = values.get(argument.name)
        if value is None and argument.fallback is None:
            if argument.required:
                raise BadArgument(f"{argument.name} is missing: {argument.expected}")
            if argument.default is not None:
                checked[argument.name] = argument.default
            continue
        checked[argument.name] = argument.check(value)
    return checked


def shown(value: Any) -> str:
    """Return the beginning of what a model sent, for a message."""
    if isinstance(value, str):
        return repr(value[:60])
    if isinstance(value, (int, float, bool)) or value is None:
        # A long integer is not converted: Python refuses to print one of more than 4300 digits.
        return "a huge number" if isinstance(value, int) and abs(value) > 10**15 else repr(value)
    return f"a {type(value).__name__}"
