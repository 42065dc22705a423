"""The paired browsers: each is a session, and identifies itself with a token in a cookie.

The file contains only hashes of the tokens. The server and `lupin console revoke` both write it, under a lock.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.console.authority import Role, Session
from lupin_runtime.console.shared_file import locked
from lupin_runtime.json_text import parse_json
from lupin_runtime.stack.runs import state_directory

SESSION_LIFETIME_S = 30 * 86400.0  # a browser that is not used for this long has to be paired again
MAX_SESSIONS = 200
_NOTE_USE_PERIOD_S = 3600.0


def sessions_file() -> Path:
    """Return the file of this user's paired browsers, which all runs share."""
    return state_directory() / "console" / "sessions.json"


@dataclass(frozen=True)
class Pairing:
    """A paired browser as stored in the file; times are Unix time in seconds.

    `by_itself`: it was paired without a code, because it runs on this computer.
    """

    name: str
    role: Role
    token_sha256: str
    paired_s: float
    used_s: float
    by_itself: bool = False


class Sessions:
    """The paired browsers of this user. `clock` is the wall clock in seconds.

    `add`, `note_use` and `revoke` wait for other processes and for the disk, so they must not be called on an event loop.

    The constructor raises MalformedFile if the file is damaged, instead of dropping sessions silently. If the file is damaged
    later, the sessions that were read stay valid, so that people can stop the robot, and every change raises MalformedFile.
    """

    def __init__(self, path: Path, clock: Callable[[], float] = time.time) -> None:
        self._path = path
        self._clock = clock
        self._seen: tuple[int, int, int] | None = None
        self._sessions: dict[str, Session] = {}
        self._noted_s: dict[str, float] = {}
        self._reading = threading.Lock()
        self._pairings: dict[str, Pairing] = self._read()

    def all(self) -> list[Pairing]:
        """Return the paired browsers, the most recently used first."""
        self.refresh()
        return sorted(self._pairings.values(), key=lambda pairing: -pairing.used_s)

    def add(self, kind: str, role: Role, *, by_itself: bool = False) -> tuple[Session, str]:
        """Pair a browser; returns its session, named after its kind and a number, and its token.

        Beyond MAX_SESSIONS, one that was paired without a code is forgotten, since it can be paired again in the same way, or
        else the one that has not been used for the longest time.
        """
        token = secrets.token_urlsafe(32)
        now_s = self._clock()
        with self._changing() as pairings:
            names = {pairing.name for pairing in pairings.values()}
            name = next(f"{kind}-{number}" for number in range(1, len(names) + 2) if f"{kind}-{number}" not in names)
            pairings[_hash(token)] = Pairing(name, role, _hash(token), now_s, now_s, by_itself)
            while len(pairings) > MAX_SESSIONS:
                others = (key for key in pairings if key != _hash(token))
                del pairings[min(others, key=lambda key: (not pairings[key].by_itself, pairings[key].used_s))]
        session = self.find(token)
        assert session is not None
        return session, token

    def find(self, token: str) -> Session | None:
        """Return the session of a token, always the same object; None if it is unknown, revoked or expired."""
        self.refresh()
        key = _hash(token)
        pairing = self._pairings.get(key)
        if pairing is None or self._clock() - pairing.used_s > SESSION_LIFETIME_S:
            return None
        return self._sessions.setdefault(key, Session(pairing.name, pairing.role))

    def is_use_due(self, token: str) -> bool:
        """Return whether `note_use` is to be called now. After it has returned True, it returns False for an hour."""
        key, now_s = _hash(token), self._clock()
        pairing = self._pairings.get(key)
        noted_s = self._noted_s.get(key, pairing.used_s if pairing else now_s)
        if abs(now_s - noted_s) <= _NOTE_USE_PERIOD_S:
            return False
        self._noted_s[key] = now_s
        return True

    def note_use(self, token: str) -> None:
        """Store that a browser has just been used, so that its session does not expire."""
        key = _hash(token)
        with self._changing() as pairings:
            if key in pairings:
                pairings[key] = replace(pairings[key], used_s=self._clock())

    def is_valid(self, session: Session) -> bool:
        """Return whether a session that `find` has returned is still paired."""
        self.refresh()
        return any(each is session and key in self._pairings for key, each in self._sessions.items())

    def revoke(self, name: str) -> bool:
        """Unpair a browser; returns whether there was one with this name."""
        with self._changing() as pairings:
            keys = [key for key, pairing in pairings.items() if pairing.name == name]
            for key in keys:
                del pairings[key]
        return bool(keys)

    def refresh(self) -> None:
        """Read the file again if another process has changed it."""
        with self._reading:
            try:
                status = self._path.stat()
            except FileNotFoundError:
                self._seen, self._pairings = None, {}
                return
            seen = (status.st_mtime_ns, status.st_ino, status.st_size)
            if seen != self._seen:
                with contextlib.suppress(MalformedFile, OSError):
                    self._pairings = self._read()
                self._seen = seen

    def _read(self) -> dict[str, Pairing]:
        try:
            rows = parse_json(read_bounded_text(self._path))["sessions"]
            pairings = [Pairing(**{**row, "role": Role(row["role"])}) for row in rows]
            if not all(isinstance(value, str) for row in pairings for value in (row.name, row.token_sha256)):
                raise TypeError("a name is not text")
            if not all(isinstance(value, (int, float)) for row in pairings for value in (row.paired_s, row.used_s)):
                raise TypeError("a time is not a number")
        except FileNotFoundError:
            return {}
        except (ValueError, KeyError, TypeError) as error:
            raise MalformedFile(self._path, None, f"{error}; move it away, and pair the browsers again") from error
        return {pairing.token_sha256: pairing for pairing in pairings}

    @contextmanager
    def _changing(self) -> Iterator[dict[str, Pairing]]:
        with locked(self._path):
            pairings = self._read()
            yield pairings
            rows = [{**asdict(pairing), "role": pairing.role.value} for pairing in pairings.values()]
            write_atomically(self._path, json.dumps({"sessions": rows}, indent=1), mode=0o600, sync=True)
        self.refresh()


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
