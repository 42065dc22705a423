"""Variables of the environment by which an operator switches something off."""

from __future__ import annotations

from collections.abc import Mapping

OFF = ("false", "0", "no", "off")


def is_off(environment: Mapping[str, str], name: str) -> bool:
    """Return whether the variable says so, in any case. One that is unset or empty does not."""
    return environment.get(name, "").strip().lower() in OFF
