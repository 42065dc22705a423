"""Host keys against a real sshd: asked once, kept by robot, and a changed one always fatal."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from lupin_cli.target.base import HostKeyChanged, HostKeyUnknown, Script
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.trust import Trust


def fingerprint_by_keygen(public: Path) -> str:
    return subprocess.run(["ssh-keygen", "-lf", str(public)], capture_output=True, text=True, check=True).stdout.split()[1]


def test_an_unknown_key_is_refused_where_nobody_can_be_asked_and_the_command_to_accept_it_is_named(sshd, tmp_path) -> None:
    target = SshTarget("greenhouse", sshd.destination, Trust(tmp_path / "own", tmp_path / "users"))
    with pytest.raises(HostKeyUnknown) as caught:
        target.connect()
    seen = fingerprint_by_keygen(sshd.directory / "host_ed25519.pub")
    assert seen in str(caught.value)
    assert caught.value.next_command == f"lupin robots check greenhouse --accept {seen}"
    assert not (tmp_path / "own").exists()


def test_a_person_sees_the_fingerprint_and_is_asked_once(sshd, tmp_path) -> None:
    questions: list[str] = []

    def yes(question: str) -> bool:
        questions.append(question)
        return True

    for _ in range(2):
        target = SshTarget("greenhouse", sshd.destination, Trust(tmp_path / "own", tmp_path / "users", ask=yes))
        assert target.batch([Script("hello", "echo hello")])["hello"].stdout == "hello\n"
        target.close()
    assert len(questions) == 1 and fingerprint_by_keygen(sshd.directory / "host_ed25519.pub") in questions[0]


def test_who_says_no_is_not_connected(sshd, tmp_path) -> None:
    target = SshTarget("greenhouse", sshd.destination, Trust(tmp_path / "own", tmp_path / "users", ask=lambda _: False))
    with pytest.raises(HostKeyUnknown):
        target.connect()
    assert not (tmp_path / "own").exists()


def test_a_key_accepted_by_its_fingerprint_serves_under_another_address(sshd, tmp_path) -> None:
    accept = fingerprint_by_keygen(sshd.directory / "host_ed25519.pub")
    first = SshTarget("greenhouse", sshd.destination, Trust(tmp_path / "own", tmp_path / "users", accept=accept))
    first.connect()
    first.close()
    elsewhere = replace(sshd.destination, host="localhost")
    second = SshTarget("greenhouse", elsewhere, Trust(tmp_path / "own", tmp_path / "users"))
    second.connect()
    second.close()


def test_another_fingerprint_than_the_accepted_one_is_refused(sshd, tmp_path) -> None:
    trust = Trust(tmp_path / "own", tmp_path / "users", ask=lambda _: True, accept="SHA256:somethingElse")
    with pytest.raises(HostKeyUnknown, match="not SHA256:somethingElse"):
        SshTarget("greenhouse", sshd.destination, trust).connect()


@pytest.mark.parametrize("where", ["own", "users"])
def test_a_changed_key_is_fatal_also_where_a_person_would_say_yes_until_it_is_forgotten(sshd, tmp_path, where) -> None:
    other = tmp_path / "other"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(other)], check=True)
    key = " ".join(other.with_suffix(".pub").read_text().split()[:2])
    name = "greenhouse" if where == "own" else sshd.destination.known_as
    (tmp_path / where).write_text(f"another {key}\n{name} {key}\n")
    trust = Trust(tmp_path / "own", tmp_path / "users", ask=lambda _: True)
    with pytest.raises(HostKeyChanged) as caught:
        SshTarget("greenhouse", sshd.destination, trust).connect()
    assert caught.value.next_command == "lupin robots forget greenhouse"
    assert fingerprint_by_keygen(other) in str(caught.value)
    assert trust.forget("greenhouse", [sshd.destination]) != []
    target = SshTarget("greenhouse", sshd.destination, trust)
    target.connect()
    target.close()
    assert "another" in (tmp_path / where).read_text()  # a neighbour's key is still there


def test_the_key_that_the_users_own_ssh_accepted_needs_no_question(sshd, tmp_path) -> None:
    (tmp_path / "users").write_text(f"{sshd.destination.known_as} {sshd.host_key}\n")
    target = SshTarget("greenhouse", sshd.destination, Trust(tmp_path / "own", tmp_path / "users"))
    target.connect()
    target.close()


def test_a_robot_is_known_by_its_own_lines_hashed_or_not_whatever_stands_on_the_others(sshd, tmp_path) -> None:
    users, address = tmp_path / "users", sshd.destination.known_as
    users.write_text(f"{address} {sshd.host_key}\n")
    subprocess.run(["ssh-keygen", "-q", "-H", "-f", str(users)], check=True, capture_output=True)
    hashed = users.read_text()
    assert hashed.startswith("|1|") and address not in hashed
    broken = [
        "# a word",
        "",
        "alone",
        f"{address} ssh-ed25519",
        f"{address} ssh-ed25519 AAAA",
        "|1|?|? ssh-rsa AAAA",
        "|1| x y",
    ]
    users.write_bytes(b"\xff\xfe\n" + "\n".join(broken).encode() + b"\n" + hashed.encode())
    target = SshTarget("greenhouse", sshd.destination, Trust(tmp_path / "own", users))
    target.connect()
    target.close()
    users.write_text(hashed.replace("|1|", "|1|AAAA"))
    with pytest.raises(HostKeyUnknown):
        SshTarget("greenhouse", sshd.destination, Trust(tmp_path / "own", users)).connect()
