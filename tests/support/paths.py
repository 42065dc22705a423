"""The paths of the checkout and of test data."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
INTERFACES = ROOT / "interfaces"
CAPTURED_FACTS = ROOT / "tests/lupin_cli/facts/captured"
