"""Functions that change captured facts, for tests of checks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from lupin_cli.facts.sockets import Socket, Sockets


def without_port(port: int) -> Callable[[Sockets], Sockets]:
    return lambda sockets: Sockets(tuple(each for each in sockets.entries if each.port != port))


def with_socket(**fields: Any) -> Callable[[Sockets], Sockets]:
    return lambda sockets: Sockets((*sockets.entries, Socket(**fields)))


def changed(index: int, **fields: Any) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """Return a function that changes one element of a tuple."""
    return lambda values: tuple(replace(each, **fields) if at == index else each for at, each in enumerate(values))


def own_profile(**fields: Any) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    return lambda profiles: tuple(replace(each, **fields) if "/.config/" in each.path else each for each in profiles)


def without_access_point(routes: Any) -> Any:
    return replace(routes, main=tuple(route for route in routes.main if not route.destination.startswith("192.168.42.")))
