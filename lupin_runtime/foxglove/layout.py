"""The layout that Lupin ships for Foxglove and Lichtblick: map, robot, cameras, plots and log. It publishes nothing."""

from __future__ import annotations

from pathlib import Path

LAYOUT = Path(__file__).with_name("layout.json")
