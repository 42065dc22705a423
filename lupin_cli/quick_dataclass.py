"""`dataclass` in a tenth of the time: the standard library writes and compiles six functions for each class, the better part of
a millisecond, and a command brings eighty classes along before it says a word.

The fields are the standard library's own, so `fields`, `replace`, `asdict` and `field(...)` work as ever; making an instance
takes some 2 us longer. Without `order`, `slots` and `InitVar`, which nothing here needs.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, kw_only=False):
        """As `dataclasses.dataclass`."""
        if cls is None:
            return lambda cls: dataclass(cls, frozen=frozen, kw_only=kw_only)
        derived = any(dataclasses.is_dataclass(base) for base in cls.__mro__[1:])
        # One frozen class derives from another only: the library's rule, for which it has to know.
        cls = dataclasses.dataclass(init=False, repr=False, eq=False, frozen=frozen and derived, kw_only=kw_only)(cls)
        cls.__dataclass_params__.frozen = frozen
        for name, method in _methods(cls, frozen).items():
            if name not in cls.__dict__:
                setattr(cls, name, method)
        return cls


def _methods(cls: type, frozen: bool) -> dict[str, Any]:
    """The methods that the standard library would have written out for `cls`, as loops over its fields."""
    every = dataclasses.fields(cls)
    positional = tuple(field.name for field in every if field.init and not field.kw_only)
    accepted = frozenset(field.name for field in every if field.init)
    defaults = tuple((field.name, field.default, field.default_factory) for field in every)
    compared = tuple(field.name for field in every if field.compare)
    shown = tuple(field.name for field in every if field.repr)
    missing = dataclasses.MISSING
    after = hasattr(cls, "__post_init__")

    def init(self: Any, *given: Any, **named: Any) -> None:
        values = self.__dict__
        if len(given) > len(positional):
            raise TypeError(f"{cls.__qualname__} takes {len(positional)} positional arguments, not {len(given)}")
        for name, value in zip(positional, given):
            values[name] = value
        for name, value in named.items():
            if name not in accepted or name in values:
                raise TypeError(
                    f"{cls.__qualname__} got {'two values for' if name in values else 'an unknown'} argument {name!r}"
                )
            values[name] = value
        if len(values) < len(defaults):
            for name, default, factory in defaults:
                if name not in values:
                    if default is not missing:
                        values[name] = default
                    elif factory is not missing:
                        values[name] = factory()
                    elif name in accepted:
                        raise TypeError(f"{cls.__qualname__} wants an argument {name!r}")
        if after:
            self.__post_init__()

    def key(self: Any) -> tuple[Any, ...]:
        return tuple([getattr(self, name) for name in compared])

    def equal(self: Any, other: object) -> Any:
        return key(self) == key(other) if other.__class__ is self.__class__ else NotImplemented

    def show(self: Any) -> str:
        return f"{self.__class__.__qualname__}({', '.join(f'{name}={getattr(self, name)!r}' for name in shown)})"

    methods: dict[str, Any] = {"__init__": init, "__eq__": equal, "__repr__": show}
    if not frozen:
        return {**methods, "__hash__": None}

    def refuse_value(self: Any, name: str, value: Any) -> None:
        raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")

    def refuse_end(self: Any, name: str) -> None:
        raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")

    return {
        **methods,
        "__hash__": lambda self: hash(key(self)),
        "__setattr__": refuse_value,
        "__delattr__": refuse_end,
    }
