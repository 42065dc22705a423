"""`quick_dataclass` against the standard library's: the same class made by both must behave the same."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from dataclasses import field
from typing import Any, ClassVar

import pytest

from lupin_cli import quick_dataclass


def _made(dataclass: Any, **options: Any) -> Any:
    @dataclass(**options)
    class Reading:
        """A class with every kind of field that the project uses."""

        kind: ClassVar[str] = "reading"
        name: str
        value: float = 1.5
        lines: list[str] = field(default_factory=list)
        noted: str = field(default="", repr=False, compare=False)
        seen: int = field(default=0, init=False)

        def __post_init__(self) -> None:
            if self.value < 0:
                raise ValueError("negative")

    return Reading


BOTH = [quick_dataclass.dataclass, dataclasses.dataclass]
OPTIONS = [{}, {"frozen": True}, {"kw_only": True}, {"frozen": True, "kw_only": True}]
CALLS: list[tuple[tuple[Any, ...], dict[str, Any]]] = [
    ((), {"name": "a"}),
    (("a",), {}),
    (("a", 2.0, ["x"]), {}),
    (("a",), {"noted": "n", "value": 3.0}),
    ((), {}),
    (("a", 2.0, [], "n", 5), {}),
    (("a",), {"name": "b"}),
    (("a",), {"seen": 5}),
    (("a",), {"unknown": 5}),
    (("a", -1.0), {}),
]


def _told(make: Any) -> Any:
    """What comes of it: a value that can be compared, or the error's type."""
    try:
        return make()
    except Exception as error:
        return type(error)


@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize(("given", "named"), CALLS, ids=str)
def test_it_takes_and_refuses_what_the_library_s_own_does(
    options: dict[str, Any], given: tuple[Any, ...], named: dict[str, Any]
) -> None:
    ours, theirs = (_made(each, **options) for each in BOTH)
    told = _told(lambda: dataclasses.asdict(ours(*given, **named)))
    assert told == _told(lambda: dataclasses.asdict(theirs(*given, **named)))


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_what_is_made_behaves_the_same(options: dict[str, Any]) -> None:
    ours, theirs = (_made(each, **options) for each in BOTH)

    def behaviour(made: Any) -> list[Any]:
        one, same, other = made(name="a"), made(name="a", noted="passed over"), made(name="b")
        return [
            one == same,
            one == other,
            one == "a",
            repr(other),
            dataclasses.asdict(one),
            repr(dataclasses.replace(one, value=2.0)),
            [each.name for each in dataclasses.fields(one)],
            made.kind,
            copy.deepcopy(other) == other,
            one.lines is same.lines,
            _told(lambda: hash(made(name="a", lines=())) == hash(made(name="a", lines=()))),
            _told(lambda: setattr(one, "name", "c")),
            _told(lambda: delattr(one, "name")),
            _told(lambda: dataclasses.replace(one, unknown=1)),
        ]

    assert behaviour(ours) == behaviour(theirs)


@quick_dataclass.dataclass(frozen=True)
class Point:
    """At the module's level, as pickle wants it."""

    x_m: float
    y_m: float = 0.0


def test_it_is_pickled_and_matched_as_any_other() -> None:
    assert pickle.loads(pickle.dumps(Point(1.0))) == Point(1.0, 0.0)
    match Point(1.0, 2.0):
        case Point(x, y):
            assert (x, y) == (1.0, 2.0)


def test_one_class_extends_another_by_either() -> None:
    for each in BOTH:

        @each(frozen=True)
        class Point3(Point):
            z_m: float = 0.0

        assert repr(Point3(1.0, z_m=3.0)).endswith("Point3(x_m=1.0, y_m=0.0, z_m=3.0)")
        assert Point3(1.0) != Point(1.0)
        with pytest.raises(dataclasses.FrozenInstanceError):
            Point3(1.0).z_m = 1.0  # type: ignore[misc]
