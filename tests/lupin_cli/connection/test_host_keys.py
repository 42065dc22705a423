"""Host keys, against a real sshd: a person is asked once, keys are stored by robot, a changed key is always fatal."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.bench_known_hosts import compare
from lupin_cli.connection.base import HostKeyChanged, HostKeyUnknown, Script, TargetError
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.ssh import SshTarget
from tests.lupin_cli.connection.conftest import start_sshd

if TYPE_CHECKING:
    from tests.lupin_cli.connection.conftest import Sshd


def fingerprint_by_keygen(public: Path) -> str:
    """Return the fingerprint that `ssh-keygen` prints for a public key."""
    return subprocess.run(["ssh-keygen", "-lf", str(public)], capture_output=True, text=True, check=True).stdout.split()[1]


def test_unknown_key_is_refused_and_accept_command_named(sshd: Sshd, tmp_path: Path) -> None:
    target = SshTarget("greenhouse", sshd.destination, KnownHosts(tmp_path / "own", tmp_path / "users"))
    with pytest.raises(HostKeyUnknown) as caught:
        target.connect()
    seen = fingerprint_by_keygen(sshd.directory / "host_ed25519.pub")
    assert seen in str(caught.value)
    assert caught.value.next_command == f"lupin robots check greenhouse --accept {seen}"
    assert not (tmp_path / "own").exists()


def test_person_sees_fingerprint_and_is_asked_once(sshd: Sshd, tmp_path: Path) -> None:
    questions: list[str] = []

    def yes(question: str) -> bool:
        questions.append(question)
        return True

    for _ in range(2):
        target = SshTarget("greenhouse", sshd.destination, KnownHosts(tmp_path / "own", tmp_path / "users", confirm=yes))
        assert target.batch([Script("hello", "echo hello")])["hello"].stdout == "hello\n"
        target.close()
    assert len(questions) == 1 and fingerprint_by_keygen(sshd.directory / "host_ed25519.pub") in questions[0]


def test_declined_key_is_not_connected_to(sshd: Sshd, tmp_path: Path) -> None:
    target = SshTarget(
        "greenhouse", sshd.destination, KnownHosts(tmp_path / "own", tmp_path / "users", confirm=lambda _: False)
    )
    with pytest.raises(HostKeyUnknown):
        target.connect()
    assert not (tmp_path / "own").exists()


def test_accepted_key_is_valid_at_another_address(sshd: Sshd, tmp_path: Path) -> None:
    accept = fingerprint_by_keygen(sshd.directory / "host_ed25519.pub")
    first = SshTarget("greenhouse", sshd.destination, KnownHosts(tmp_path / "own", tmp_path / "users", accept=accept))
    first.connect()
    first.close()
    elsewhere = replace(sshd.destination, host="localhost")
    second = SshTarget("greenhouse", elsewhere, KnownHosts(tmp_path / "own", tmp_path / "users"))
    second.connect()
    second.close()


def test_key_with_another_fingerprint_is_refused(sshd: Sshd, tmp_path: Path) -> None:
    known_hosts = KnownHosts(tmp_path / "own", tmp_path / "users", confirm=lambda _: True, accept="SHA256:somethingElse")
    with pytest.raises(HostKeyUnknown, match="not SHA256:somethingElse"):
        SshTarget("greenhouse", sshd.destination, known_hosts).connect()


@pytest.mark.parametrize("where", ["own", "users"])
def test_changed_key_is_fatal_until_it_is_forgotten(sshd: Sshd, tmp_path: Path, where: str) -> None:
    other = tmp_path / "other"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(other)], check=True)
    key = " ".join(other.with_suffix(".pub").read_text().split()[:2])
    name = "greenhouse" if where == "own" else sshd.destination.known_as
    (tmp_path / where).write_text(f"another {key}\n{name} {key}\n")
    known_hosts = KnownHosts(tmp_path / "own", tmp_path / "users", confirm=lambda _: True)
    with pytest.raises(HostKeyChanged) as caught:
        SshTarget("greenhouse", sshd.destination, known_hosts).connect()
    assert caught.value.next_command == "lupin robots forget greenhouse"
    assert fingerprint_by_keygen(other) in str(caught.value)
    assert known_hosts.forget("greenhouse", [sshd.destination]) != []
    target = SshTarget("greenhouse", sshd.destination, known_hosts)
    target.connect()
    target.close()
    assert "another" in (tmp_path / where).read_text()  # the key of another robot is kept


def test_key_in_user_known_hosts_is_accepted(sshd: Sshd, tmp_path: Path) -> None:
    (tmp_path / "users").write_text(f"{sshd.destination.known_as} {sshd.host_key}\n")
    target = SshTarget("greenhouse", sshd.destination, KnownHosts(tmp_path / "own", tmp_path / "users"))
    target.connect()
    target.close()


def test_hashed_entry_is_found_among_broken_lines(sshd: Sshd, tmp_path: Path) -> None:
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
        "|1|AAAAAAAAAAAAAAAAAAAAAAAAAAA=|\u00fc ssh-rsa AAAA",
    ]
    users.write_bytes(b"\xff\xfe\n" + "\n".join(broken).encode() + b"\n" + hashed.encode())
    target = SshTarget("greenhouse", sshd.destination, KnownHosts(tmp_path / "own", users))
    target.connect()
    target.close()
    users.write_text(hashed.replace("|1|", "|1|AAAA"))
    with pytest.raises(HostKeyUnknown):
        SshTarget("greenhouse", sshd.destination, KnownHosts(tmp_path / "own", users)).connect()


def other_key(folder: Path, name: str, kind: str = "ed25519") -> str:
    """Make a key; return its type and public part."""
    subprocess.run(["ssh-keygen", "-q", "-t", kind, "-N", "", "-f", str(folder / name)], check=True)
    return " ".join((folder / f"{name}.pub").read_text().split()[:2])


@pytest.mark.parametrize("marked", ["own", "users"])
def test_revoked_key_is_refused_though_it_was_accepted(sshd: Sshd, tmp_path: Path, marked: str) -> None:
    address = sshd.destination.known_as
    (tmp_path / "own").write_text(f"greenhouse {sshd.host_key}\n")
    (tmp_path / "users").write_text(f"{address} {sshd.host_key}\n")
    revoked = f"@revoked {'greenhouse' if marked == 'own' else '*'} {sshd.host_key}\n"
    with (tmp_path / marked).open("a") as file:
        file.write(revoked)
    known_hosts = KnownHosts(tmp_path / "own", tmp_path / "users", confirm=lambda _: True)
    with pytest.raises(HostKeyChanged, match="revokes") as caught:
        SshTarget("greenhouse", sshd.destination, known_hosts).connect()
    shown = subprocess.run(caught.value.next_command, shell=True, capture_output=True, text=True, check=True).stdout
    assert fingerprint_by_keygen(sshd.directory / "host_ed25519.pub") in shown


def test_every_key_of_a_type_is_accepted(sshd: Sshd, tmp_path: Path) -> None:
    address = sshd.destination.known_as
    lines = [other_key(tmp_path, "before"), sshd.host_key, other_key(tmp_path, "after"), other_key(tmp_path, "rsa", "rsa")]
    (tmp_path / "users").write_text("".join(f"{address} {line}\n" for line in lines))
    target = SshTarget("greenhouse", sshd.destination, KnownHosts(tmp_path / "own", tmp_path / "users"))
    target.connect()
    target.close()


@pytest.mark.parametrize(
    ("patterns", "accepted"),
    [
        ("*", True),
        ("{address},!{address}", False),
        ("*,!10.*", True),
        ("other,[127.0.0.?]:*", True),
        ("[127.0.0.1]", False),
        ("!other", False),
    ],
)
def test_patterns_are_those_of_openssh(sshd: Sshd, tmp_path: Path, patterns: str, accepted: bool) -> None:
    address, users = sshd.destination.known_as, tmp_path / "users"
    users.write_text(f"{patterns.format(address=address)} {sshd.host_key}\n")
    by_keygen = subprocess.run(["ssh-keygen", "-F", address, "-f", str(users)], capture_output=True, check=False)
    assert (by_keygen.returncode == 0) is accepted
    target = SshTarget("greenhouse", sshd.destination, KnownHosts(tmp_path / "own", users))
    if accepted:
        target.connect()
        target.close()
    else:
        with pytest.raises(HostKeyUnknown):
            target.connect()


def test_malformed_line_of_the_robot_is_named(sshd: Sshd, tmp_path: Path) -> None:
    users, address = tmp_path / "users", sshd.destination.known_as
    users.write_text(f"other nonsense\n{address} ssh-ed25519 AAAA\n@unheard {address} {sshd.host_key}\n")
    with pytest.raises(HostKeyUnknown) as caught:
        SshTarget("greenhouse", sshd.destination, KnownHosts(tmp_path / "own", users)).connect()
    assert f"({users}:2, {users}:3 cannot be read)" in str(caught.value)


def connected(sshd: Sshd, tmp_path: Path, **fields: object) -> bool:
    """Return whether the key is accepted at a destination with these fields, without a question."""
    destination = replace(sshd.destination, original_host="robot", **fields)  # type: ignore[arg-type]
    target = SshTarget("greenhouse", destination, KnownHosts(tmp_path / "own"))
    try:
        target.connect()
    except HostKeyUnknown:
        return False
    finally:
        target.close()
    return True


def test_key_is_looked_up_under_its_alias(sshd: Sshd, tmp_path: Path) -> None:
    users = tmp_path / "users"
    users.write_text(f"pot-9 {sshd.host_key}\n{sshd.destination.known_as} {other_key(tmp_path, 'other')}\n")
    assert connected(sshd, tmp_path, host_key_alias="pot-9", user_known_hosts=(str(users),))
    with pytest.raises(HostKeyChanged):
        connected(sshd, tmp_path, user_known_hosts=(str(users),))
    assert not connected(sshd, tmp_path, host_key_alias="pot-8", user_known_hosts=(str(users),))


def test_only_the_named_files_count(sshd: Sshd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".ssh").mkdir()
    default, second = tmp_path / ".ssh/known_hosts", tmp_path / "second"
    default.write_text(f"{sshd.destination.known_as} {other_key(tmp_path, 'other')}\n")
    second.write_text(f"{sshd.destination.known_as} {sshd.host_key}\n")
    assert connected(sshd, tmp_path, user_known_hosts=(str(tmp_path / "absent"), str(second)))
    assert connected(sshd, tmp_path, user_known_hosts=(), global_known_hosts=(str(second),))
    assert not connected(sshd, tmp_path, user_known_hosts=("/dev/null",))
    assert not connected(sshd, tmp_path, user_known_hosts=())


def test_line_without_port_counts_if_no_other_key_is_known(sshd: Sshd, tmp_path: Path) -> None:
    users = tmp_path / "users"
    users.write_text(f"{sshd.destination.host} {sshd.host_key}\n")
    assert connected(sshd, tmp_path, user_known_hosts=(str(users),))
    other = other_key(tmp_path, "other")
    users.write_text(f"{sshd.destination.host} {other}\n")
    assert not connected(sshd, tmp_path, user_known_hosts=(str(users),))
    users.write_text(f"{sshd.destination.host} {sshd.host_key}\n{sshd.destination.known_as} {other}\n")
    with pytest.raises(HostKeyChanged):
        connected(sshd, tmp_path, user_known_hosts=(str(users),))


def test_authority_is_no_plain_key_and_is_named(sshd: Sshd, tmp_path: Path) -> None:
    users = tmp_path / "users"
    users.write_text(f"@cert-authority * {sshd.host_key}\n")
    known_hosts = KnownHosts(tmp_path / "own", users)
    with pytest.raises(HostKeyUnknown, match=f"{users}:1 trusts an authority's host certificates"):
        SshTarget("greenhouse", sshd.destination, known_hosts).connect()


@pytest.mark.parametrize("separator", [" ", "\t"])
def test_revoked_key_cannot_be_accepted_by_fingerprint(sshd: Sshd, tmp_path: Path, separator: str) -> None:
    users = tmp_path / "users"
    users.write_text(f"@revoked{separator}*{separator}{sshd.host_key}\n")
    accept = fingerprint_by_keygen(sshd.directory / "host_ed25519.pub")
    with pytest.raises(HostKeyChanged, match=f"{users}:1 revokes"):
        SshTarget("greenhouse", sshd.destination, KnownHosts(tmp_path / "own", users, accept=accept)).connect()


@pytest.mark.parametrize("kind", ["list", "krl", "malformed", "absent"])
def test_file_of_revoked_keys_is_obeyed(sshd: Sshd, tmp_path: Path, kind: str) -> None:
    file, other = tmp_path / "revoked", tmp_path / "other"
    other_key(tmp_path, "other")
    public = sshd.directory / "host_ed25519.pub"
    users = tmp_path / "users"
    users.write_text(f"{sshd.destination.known_as} {sshd.host_key}\n")

    def revoke(key: Path) -> None:
        if kind == "list":
            file.write_text(f"# stolen\n{key.read_text()}")
        elif kind == "malformed":
            file.write_text("nonsense\n")
        elif kind == "krl":
            subprocess.run(["ssh-keygen", "-q", "-k", "-f", str(file), str(key)], check=True, timeout=60)

    revoke(public)
    fields = {"user_known_hosts": (str(users),), "revoked_host_keys": str(file)}
    with pytest.raises(HostKeyChanged, match=f"{file}, RevokedHostKeys"):
        connected(sshd, tmp_path, **fields)
    if kind in ("list", "krl"):
        revoke(other.with_suffix(".pub"))
        assert connected(sshd, tmp_path, **fields)


def test_strict_checking_asks_nobody(sshd: Sshd, tmp_path: Path) -> None:
    destination = replace(sshd.destination, asks_for_host_keys=False)
    known_hosts = KnownHosts(tmp_path / "own", tmp_path / "users", confirm=lambda _: True)
    with pytest.raises(HostKeyUnknown):
        SshTarget("greenhouse", destination, known_hosts).connect()


def test_changed_key_of_the_system_is_left_to_its_admin(sshd: Sshd, tmp_path: Path) -> None:
    file = tmp_path / "global"
    file.write_text(f"{sshd.destination.known_as} {other_key(tmp_path, 'other')}\n")
    with pytest.raises(HostKeyChanged) as caught:
        connected(sshd, tmp_path, global_known_hosts=(str(file),))
    assert caught.value.next_command == f"sudo ssh-keygen -R '{sshd.destination.known_as}' -f {file}"


@pytest.mark.usefixtures("sshd")  # which is skipped where there is none
def test_generated_files_are_decided_as_by_ssh() -> None:
    decisions, differences = compare(20, seed=5)
    assert differences == [] and sum(decisions.values()) == 20


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.usefixtures("sshd")
def test_1000_generated_files_are_decided_as_by_ssh() -> None:
    decisions, differences = compare(1000, seed=1)
    assert differences == [] and {"OK", "NEW", "CHANGED", "REVOKED"} <= set(decisions)


@given(content=st.binary(max_size=300))
def test_no_content_of_a_known_hosts_file_raises(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    users = tmp_path_factory.getbasetemp() / "users"
    users.write_bytes(content)
    destination = Destination("10.42.0.1")
    assert KnownHosts(users, users).key_types("x", destination) == []


@pytest.mark.parametrize("option", ["Ciphers 3des-cbc", "Ciphers aes256-cbc", "MACs hmac-md5", "MACs hmac-sha1-96"])
def test_weak_algorithm_is_not_agreed_on(tmp_path: Path, option: str) -> None:
    process, sshd = start_sshd(tmp_path, extra=f"{option}\n" + ("Ciphers aes128-ctr\n" if option.startswith("MACs") else ""))
    try:
        with pytest.raises(TargetError, match="handshake"):
            SshTarget("robot", sshd.destination, sshd.known_hosts()).connect()
    finally:
        process.terminate()
        process.wait(60)
