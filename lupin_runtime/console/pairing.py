"""One-time codes that pair a browser: the terminal shows them, and people type or scan them.

A code pairs one browser. It is replaced once it has been used, and after CODE_LIFETIME_S. A wrong code does not replace it,
because anybody on the network could then lock others out. At the server's pace, the chance of guessing one of 31^8 codes
within CODE_LIFETIME_S is one in a million.
"""

from __future__ import annotations

import contextlib
import hmac
import secrets
from collections.abc import Callable

from lupin_runtime.console.authority import Refused, Role

CODE_LIFETIME_S = 3600.0
BAD_CODE = "this code is wrong, used or expired; type the one that the terminal shows, or run: lupin console code"
# Without 0, O, 1, I and L, which are easily confused.
_ALPHABET = "23456789ABCDEFGHJKMNPQRSTUVWXYZ"
_LENGTH = 8


class PairingCodes:
    """The current code of each role. Times are monotonic nanoseconds.

    `changed` is called after one is replaced. If it raises OSError, as on a full disk, `tick` calls it again.
    """

    def __init__(self, changed: Callable[[], None], now_ns: int) -> None:
        self._changed = changed
        self._codes = {role: _new_code() for role in Role}
        self._made_ns = now_ns
        self._is_announced = True

    def code(self, role: Role) -> str:
        """Return the code that pairs a browser in a role."""
        return self._codes[role]

    def redeem(self, text: str, now_ns: int) -> Role:
        """Use up a code and return its role. Raises Refused for a code that is wrong, used or too old."""
        self.tick(now_ns)
        entered = "".join(letter for letter in text.upper() if letter in _ALPHABET)
        for role, code in self._codes.items():
            if hmac.compare_digest(entered.encode(), code.encode()):
                self._codes[role] = _new_code()
                with contextlib.suppress(OSError):
                    self.announce()
                return role
        raise Refused(BAD_CODE)

    def tick(self, now_ns: int) -> None:
        """Replace codes that are too old. Raises what `changed` raises."""
        if now_ns - self._made_ns > CODE_LIFETIME_S * 1e9:
            self._codes = {role: _new_code() for role in Role}
            self._made_ns = now_ns
            self._is_announced = False
        if not self._is_announced:
            self.announce()

    def announce(self) -> None:
        """Call `changed`. Raises what it raises."""
        self._is_announced = False
        self._changed()
        self._is_announced = True


def _new_code() -> str:
    return "".join(secrets.choice(_ALPHABET) for _ in range(_LENGTH))
