"""Which times of a wall clock are certainly wrong, without asking anybody. A clock without a battery starts in 1970."""

from __future__ import annotations

from datetime import datetime, timezone

# Both are far from any time at which this line of releases is used. A later floor would find more, and age with every release.
# systemd/lupin-clock-sync.sh has the same limits.
EARLIEST_S = 1_735_689_600  # 2025-01-01, before the first version of Lupin
LATEST_S = 2_366_841_600  # 2045-01-01, 20 years after it
_LAST_YEAR_S = 253_402_300_800  # the year 10000
SET_CLOCK = "sudo timedatectl set-ntp true"
SET_CLOCK_BY_HAND = "if no time source answers, set the clock: sudo date -s 'YYYY-MM-DD hh:mm'"


def clock_fault(epoch_s: float) -> str:
    """Return why this machine's clock, which shows `epoch_s` seconds since 1970, is wrong; empty if it may be right."""
    if EARLIEST_S <= epoch_s < LATEST_S:
        return ""
    if 0 <= epoch_s < _LAST_YEAR_S:
        shown = f"{datetime.fromtimestamp(epoch_s, timezone.utc):%Y-%m-%d %H:%M} UTC"
    else:
        shown = f"{epoch_s:.0f} s since 1970"
    why = "this version of Lupin is newer" if epoch_s < EARLIEST_S else "that is decades after this version of Lupin"
    return f"this machine's clock is wrong: it shows {shown}, and {why}"
