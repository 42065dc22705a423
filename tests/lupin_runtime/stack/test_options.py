"""The options of a run, as they are stored and read again by `lupin run`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime.stack.options import Options

CHANGED = Options(
    target="robot",
    speed=2.0,
    navigation=False,
    console=True,
    map_file=Path("/maps/house.yaml"),
    initial_pose=(1.0, -2.0, 0.5),
    monitoring_rounds=3,
)


@pytest.mark.parametrize("options", [Options(), CHANGED])
def test_stored_options_are_read_again(options: Options) -> None:
    assert Options.from_json(json.loads(json.dumps(options.as_json()))) == options


@pytest.mark.parametrize(
    "stored",
    [
        {},
        {"target": 7, "speed": "fast", "nav2": None, "map_file": ["x"], "initial_pose": [1, 2], "unknown": {}},
        {"initial_pose": {"x": 1}, "sweeps": True, "layout": 3, "seed": 1.5},
        {"initial_pose": [10**400, 0.0, 0.0], "foxglove": 1},  # more than a float holds
    ],
)
def test_malformed_options_have_their_defaults(stored: dict[str, Any]) -> None:
    assert Options.from_json(stored) == Options()
