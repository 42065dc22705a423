"""The limits of the doctor's wall time in its benchmark."""

from __future__ import annotations

from typing import Any

import pytest

from bench.bench_doctor import passes


@pytest.mark.parametrize(
    ("changed", "passed"),
    [
        ({}, True),
        ({"wall_s": 1.2}, False),
        ({"connections": 2.0}, False),
        ({"with_the_graph": {"wall_s": 2.4, "limit_s": 3.0}}, True),
        ({"with_the_graph": {"wall_s": 3.4, "limit_s": 3.0}}, False),
    ],
)
def test_every_measured_time_has_its_limit(changed: dict[str, Any], passed: bool) -> None:
    assert passes({"wall_s": 0.8, "connections": 1.0, **changed}) is passed
