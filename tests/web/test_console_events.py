"""The page has words for every event of the console."""

from __future__ import annotations

from lupin_runtime.console.console_events import EventKind
from tests.support.paths import ROOT

PAGE = ROOT / "web" / "src"


def test_every_kind_of_event_has_words_on_the_page() -> None:
    table = (PAGE / "map" / "events.ts").read_text()
    assert [kind.value for kind in EventKind if f"\n  {kind.value}: " not in table] == []


def test_every_notice_is_of_a_kind_that_exists() -> None:
    history = (PAGE / "api" / "history.ts").read_text()
    named = [line.split(":")[0].strip() for line in history.splitlines() if ': "notice_' in line]
    assert named and {EventKind(name) for name in named}
