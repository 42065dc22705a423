"""One-time codes by which a browser is paired: shown in the terminal, typed or scanned once.

A code is good for one browser. It is replaced when it was used and after LIFE_S. Wrong ones do not replace it, since anybody on
the network could then keep others out; at the server's pace, guessing one of 31^8 in LIFE_S takes a chance of one in a million.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Callable

from lupin_runtime.console.authority import Refused, Role

LIFE_S = 3600.0
# Without 0 O 1 I L, which people confuse.
_ALPHABET = "23456789ABCDEFGHJKMNPQRSTUVWXYZ"
_LENGTH = 8


class PairingCodes:
    """The present code of each role. `changed` is called when one was replaced. Times are monotonic nanoseconds."""

    def __init__(self, changed: Callable[[], None], now_ns: int) -> None:
        self._changed = changed
        self._codes = {role: _new_code() for role in Role}
        self._made_ns = now_ns

    def code(self, role: Role) -> str:
        """The code that pairs a browser in a role."""
        return self._codes[role]

    def redeem(self, text: str, now_ns: int) -> Role:
        """The role of a code, which is used up by it. Raises Refused for a code that is wrong, used or too old."""
        self.tick(now_ns)
        entered = "".join(letter for letter in text.upper() if letter in _ALPHABET)
        for role, code in self._codes.items():
            if hmac.compare_digest(entered.encode(), code.encode()):
                self._codes[role] = _new_code()
                self._changed()
                return role
        raise Refused("this code is not valid (any more); type the one that the terminal shows now, or run: lupin console code")

    def tick(self, now_ns: int) -> None:
        """Replace codes that are too old."""
        if now_ns - self._made_ns > LIFE_S * 1e9:
            self._codes = {role: _new_code() for role in Role}
            self._made_ns = now_ns
            self._changed()


def _new_code() -> str:
    return "".join(secrets.choice(_ALPHABET) for _ in range(_LENGTH))
