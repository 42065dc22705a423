"""The paired browsers, in a file that two processes write."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.console.authority import Role
from lupin_runtime.console.sessions import MAX_SESSIONS, SESSION_LIFETIME_S, Sessions


class Clock:
    now_s = 1_800_000_000.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "console" / "sessions.json"


def test_token_is_found_but_not_stored(path: Path, clock: Clock) -> None:
    sessions = Sessions(path, clock)
    session, token = sessions.add("phone", Role.VIEWER)
    assert (session.name, session.role) == ("phone-1", Role.VIEWER)
    assert sessions.find(token) is session
    assert Sessions(path, clock).find(token) == session
    assert token not in path.read_text()
    assert path.stat().st_mode & 0o777 == 0o600 and path.parent.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("token", ["", "x", "../../etc/passwd", "ü" * 1000])
def test_unknown_token_has_no_session(path: Path, clock: Clock, token: str) -> None:
    sessions = Sessions(path, clock)
    sessions.add("phone", Role.OPERATOR)
    assert sessions.find(token) is None


def test_names_are_unique_and_reused(path: Path, clock: Clock) -> None:
    sessions = Sessions(path, clock)
    names = [sessions.add("phone", Role.VIEWER)[0].name for _ in range(3)]
    assert names == ["phone-1", "phone-2", "phone-3"]
    assert sessions.revoke("phone-2") and not sessions.revoke("phone-2")
    assert sessions.add("phone", Role.VIEWER)[0].name == "phone-2"


def test_unused_session_expires(path: Path, clock: Clock) -> None:
    sessions = Sessions(path, clock)
    _, used = sessions.add("phone", Role.OPERATOR)
    _, left = sessions.add("phone", Role.OPERATOR)
    assert not sessions.is_use_due(used)
    clock.now_s += SESSION_LIFETIME_S - 1
    assert sessions.find(used) is not None
    assert sessions.is_use_due(used) and not sessions.is_use_due(used), "once is enough"
    sessions.note_use(used)
    clock.now_s += 2
    assert sessions.find(used) is not None
    assert sessions.find(left) is None


def test_clock_set_back_expires_no_session(path: Path, clock: Clock) -> None:
    sessions = Sessions(path, clock)
    _, token = sessions.add("phone", Role.OPERATOR)
    clock.now_s -= 10 * SESSION_LIFETIME_S
    assert sessions.find(token) is not None and sessions.is_use_due(token)
    sessions.note_use(token)
    clock.now_s += 10 * SESSION_LIFETIME_S
    assert sessions.find(token) is None, "expired by the clock that was used when it was last used"


def test_revoking_in_another_process_ends_a_session(path: Path, clock: Clock) -> None:
    sessions = Sessions(path, clock)
    session, token = sessions.add("phone", Role.OPERATOR)
    _, kept = sessions.add("tablet", Role.OPERATOR)
    program = "import sys; from pathlib import Path; from lupin_runtime.console.sessions import Sessions; "
    program += "assert Sessions(Path(sys.argv[1])).revoke('phone-1')"
    subprocess.run([sys.executable, "-c", program, str(path)], check=True, timeout=60)
    assert not sessions.is_valid(session)
    assert sessions.find(token) is None and sessions.find(kept) is not None


def test_processes_that_pair_at_once_lose_no_browser(path: Path) -> None:
    program = "import sys; from pathlib import Path; from lupin_runtime.console.authority import Role; "
    program += "from lupin_runtime.console.sessions import Sessions; "
    program += "[Sessions(Path(sys.argv[1])).add('phone', Role.VIEWER) for _ in range(10)]"
    both = [subprocess.Popen([sys.executable, "-c", program, str(path)]) for _ in range(2)]
    assert [process.wait(60) for process in both] == [0, 0]
    assert len({pairing.name for pairing in Sessions(path).all()}) == 20


def test_number_of_sessions_is_limited(path: Path, clock: Clock) -> None:
    sessions = Sessions(path, clock)
    _, first = sessions.add("computer", Role.OPERATOR)
    for _ in range(MAX_SESSIONS):
        clock.now_s += 1
        sessions.add("computer", Role.OPERATOR)
    assert len(sessions.all()) == MAX_SESSIONS
    assert sessions.find(first) is None, "the least recently used one"


def test_browsers_paired_with_a_code_outlast_those_without(path: Path, clock: Clock) -> None:
    sessions = Sessions(path, clock)
    _, phone = sessions.add("phone", Role.OPERATOR)
    for _ in range(MAX_SESSIONS):
        clock.now_s += 1
        _, newest = sessions.add("computer", Role.OPERATOR, by_itself=True)
    assert len(sessions.all()) == MAX_SESSIONS
    assert sessions.find(phone) is not None and sessions.find(newest) is not None


def test_file_of_an_earlier_version_is_read(path: Path, clock: Clock) -> None:
    _, token = Sessions(path, clock).add("phone", Role.OPERATOR)
    stored = json.loads(path.read_text())
    del stored["sessions"][0]["by_itself"]
    path.write_text(json.dumps(stored))
    assert Sessions(path, clock).find(token) is not None


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        '{"sessions": 3}',
        '{"sessions": [{"name": "a"}]}',
        '{"sessions": [{"name": 1, "role": "viewer", "token_sha256": "a", "paired_s": 0, "used_s": 0}]}',
        '{"sessions": [{"name": "a", "role": "root", "token_sha256": "a", "paired_s": 0, "used_s": 0}]}',
        '{"sessions": [{"name": "a", "role": "viewer", "token_sha256": "a", "paired_s": 0, "used_s": "x"}]}',
    ],
)
def test_damaged_file_is_named_and_kept(path: Path, content: str) -> None:
    path.parent.mkdir()
    path.write_text(content)
    with pytest.raises(MalformedFile, match=r"sessions\.json.*move it away"):
        Sessions(path)
    assert path.read_text() == content


def test_sessions_outlive_damage_to_the_file(path: Path, clock: Clock) -> None:
    sessions = Sessions(path, clock)
    session, token = sessions.add("phone", Role.OPERATOR)
    content = path.read_text()
    path.write_text(content[:50])
    assert sessions.find(token) is session and sessions.is_valid(session)
    with pytest.raises(MalformedFile):
        sessions.add("phone", Role.OPERATOR)
    assert path.read_text() == content[:50]
    path.write_text('{"sessions": []}')
    assert sessions.find(token) is None and not sessions.is_valid(session)


def test_file_is_plain_json(path: Path, clock: Clock) -> None:
    Sessions(path, clock).add("phone", Role.VIEWER)
    assert [row["name"] for row in json.loads(path.read_text())["sessions"]] == ["phone-1"]
