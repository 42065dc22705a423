"""Where the checkout and the data of tests are."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CAPTURED_FACTS = ROOT / "tests/lupin_cli/facts/captured"
