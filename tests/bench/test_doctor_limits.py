"""The limits of the doctor's wall time in its benchmark."""

from __future__ import annotations

from typing import Any

import pytest

from bench import bench_doctor


@pytest.mark.parametrize(
    ("changed", "passed"),
    [
        ({}, True),
        ({"wall_s": 1.2}, False),
        ({"connections": 2.0}, False),
        ({"with_the_graph": {"wall_s": 2.4}}, True),
        ({"with_the_graph": {"wall_s": 3.4}}, False),
    ],
)
def test_every_measured_time_has_its_limit(changed: dict[str, Any], passed: bool) -> None:
    checks = bench_doctor.main.compare({"wall_s": 0.8, "connections": 1.0, **changed})
    assert all(check.met for check in checks.values()) is passed
