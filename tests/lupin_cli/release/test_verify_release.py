"""Verification of a release in a folder, by the real ssh-keygen: only what was signed, by a trusted key, passes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lupin_cli.release import verify_release
from lupin_cli.release.signing_key import SigningKey, ensure_key
from lupin_cli.release.verification import NOT_VERIFIED, UNDAMAGED, parse_damage, verification_script
from lupin_cli.release.verify_release import BUILT, MANIFEST, SIGNATURE, SIGNED, UNSIGNED, find_damage, record, statement

ID = "0a1b2c3d4e5f"
ME = os.geteuid()


@dataclass(frozen=True)
class SignedRelease:
    """A release in a folder, the key that signed it, and the list of trusted keys."""

    folder: Path
    key: SigningKey
    signers: Path

    def sign(self, key: SigningKey | None = None, release: str = ID) -> None:
        """Sign the folder as it is."""
        text = statement(release, (self.folder / MANIFEST).read_bytes(), (self.folder / BUILT).read_bytes())
        (self.folder / SIGNED).write_bytes(text)
        (self.folder / SIGNATURE).write_bytes((key or self.key).sign(text))

    def damage(self, *, quick: bool = False) -> list[str]:
        """Verify it."""
        return list(find_damage(str(self.folder), str(self.signers), quick=quick, owner=ME))


@pytest.fixture
def signed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SignedRelease:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folder = tmp_path / "releases" / ID
    (folder / "lib").mkdir(parents=True)
    (folder / "lib/a.py").write_text("x = 1\n")
    (folder / "release.json").write_text("{}\n")
    names = ("lib/a.py", "release.json")
    listed = subprocess.run(["sha256sum", *names], cwd=folder, capture_output=True, check=True).stdout
    (folder / MANIFEST).write_bytes(listed)
    (folder / "lib/a.pyc").write_bytes(b"byte code")
    (folder / "bin").mkdir()
    (folder / "bin/python3").symlink_to("/usr/bin/python3.11")
    (folder / BUILT).write_text(record(str(folder)))
    key = ensure_key()
    signers = tmp_path / "signers"
    signers.write_text(key.public.signers_line)
    release = SignedRelease(folder, key, signers)
    release.sign()
    return release


def another_key(folder: Path, monkeypatch: pytest.MonkeyPatch) -> SigningKey:
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "another operator"))
    return ensure_key()


def test_release_passes_as_it_was_signed(signed: SignedRelease) -> None:
    assert signed.damage() == [] and signed.damage(quick=True) == []
    built = [line[66:] for line in (signed.folder / BUILT).read_text().splitlines()]
    assert built == ["bin/python3", "lib/a.pyc"], "what the robot made, and nothing that was sent"


def _add_and_list(folder: Path) -> None:
    (folder / "lib/evil.py").write_text("")
    (folder / BUILT).write_text(record(str(folder)))


def _link(path: Path, target: str) -> None:
    """Replace a file, link or folder by a link; what it was is moved beside the release."""
    release = next(parent for parent in path.parents if parent.name == ID)
    path.rename(release.parent / f"moved-{path.name}")
    path.symlink_to(target)


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


DAMAGE: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "changed": (lambda folder: (folder / "lib/a.py").write_text("x = 2\n"), ["lib/a.py (changed)"]),
    "truncated": (lambda folder: (folder / "lib/a.pyc").write_bytes(b"byte"), ["lib/a.pyc (changed)"]),
    "missing": (lambda folder: (folder / "release.json").rename(folder.parent / "away"), ["release.json (missing)"]),
    "added": (lambda folder: (folder / "lib/numpy.py").write_text(""), ["lib/numpy.py (added)"]),
    "added and listed": (_add_and_list, ["built (changed)"]),
    "added, odd name": (lambda folder: (folder / "lib/\n\x1b").write_text(""), ["lib/\n\x1b (added)"]),
    "link elsewhere": (lambda folder: _link(folder / "bin/python3", "/tmp/python3"), ["bin/python3 (changed)"]),
    "link to the content": (lambda folder: _link(folder / "lib/a.py", "../../moved-a.py"), ["lib/a.py (changed)"]),
    "linked folder": (
        lambda folder: _link(folder / "lib", "../moved-lib"),
        ["lib (added)", "lib/a.py (missing)", "lib/a.pyc (missing)"],
    ),
    "pipe": (lambda folder: _pipe(folder / "lib/a.py"), ["lib/a.py (changed)"]),
    "writable": (lambda folder: (folder / "lib").chmod(0o777), ["lib (other users may change it: mode 0777)"]),
    "manifest": (lambda folder: (folder / MANIFEST).write_text("half a lin"), ["manifest (changed)"]),
    "no list": (lambda folder: (folder / BUILT).rename(folder.parent / "away"), ["built (missing)"]),
    "unsigned": (lambda folder: (folder / SIGNED).rename(folder.parent / "away"), [UNSIGNED]),
    "no signature": (lambda folder: (folder / SIGNATURE).rename(folder.parent / "away"), ["signed.sig (missing)"]),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damage_is_named_by_path_and_reason(signed: SignedRelease, kind: str) -> None:
    spoil, expected = DAMAGE[kind]
    spoil(signed.folder)
    assert signed.damage() == expected
    assert signed.damage(quick=True) == expected


def test_quick_check_reads_only_files_with_another_time(signed: SignedRelease) -> None:
    path = signed.folder / "lib/a.py"
    os.utime(path, (0, 0))
    path.write_bytes(b"x = 3\n")
    os.utime(path, (0, 0))  # as if a block of the disk had changed
    assert signed.damage(quick=True) == []
    assert signed.damage() == ["lib/a.py (changed)"]


def test_signature_by_a_foreign_key_is_refused(signed: SignedRelease, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    foreign = another_key(tmp_path, monkeypatch)
    signed.sign(foreign)
    assert signed.damage() == [f"signed.sig (made by a key that is not in {signed.signers})"]
    with signed.signers.open("a") as file:
        file.write(foreign.public.signers_line)
    assert signed.damage() == [], "a further key is trusted besides the first one"


def test_key_for_another_purpose_is_refused(signed: SignedRelease) -> None:
    line = signed.signers.read_text()
    signed.signers.write_text(line.replace("lupin-release", "git"))
    assert [each.partition(" ")[0] for each in signed.damage()] == ["signed.sig"]


def test_signed_text_of_another_release_is_refused(signed: SignedRelease) -> None:
    signed.sign(release="ffffffffffff")
    assert signed.damage() == ["signed (of another release)"]


def test_signed_text_without_digests_is_refused(signed: SignedRelease) -> None:
    text = f"release {ID}\n".encode()
    (signed.folder / SIGNED).write_bytes(text)
    (signed.folder / SIGNATURE).write_bytes(signed.key.sign(text))
    assert signed.damage() == ["manifest (changed)"]
    text = b"release " + ID.encode()
    (signed.folder / SIGNED).write_bytes(text)
    (signed.folder / SIGNATURE).write_bytes(signed.key.sign(text))
    assert signed.damage() == ["signed (malformed)"]


def test_lists_of_another_signed_release_are_refused(signed: SignedRelease) -> None:
    old = (signed.folder / SIGNED).read_bytes(), (signed.folder / SIGNATURE).read_bytes()
    (signed.folder / "lib/a.pyc").write_bytes(b"other byte code")
    (signed.folder / BUILT).write_text("")
    (signed.folder / BUILT).write_text(record(str(signed.folder)))
    signed.sign()
    assert signed.damage() == []
    (signed.folder / SIGNED).write_bytes(old[0])
    (signed.folder / SIGNATURE).write_bytes(old[1])
    assert signed.damage() == ["built (changed)"]


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_any_changed_byte_of_text_or_signature_is_refused(signed: SignedRelease, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from((SIGNED, SIGNATURE)))
    path = signed.folder / name
    before = path.read_bytes()
    at = data.draw(st.integers(0, len(before) - 1))
    changed = data.draw(st.integers(33, 126).filter(lambda byte: byte != before[at]))
    if before[at : at + 1].isspace():
        return  # ssh-keygen ignores line breaks in the signature
    path.write_bytes(before[:at] + bytes([changed]) + before[at + 1 :])
    damage = signed.damage()
    path.write_bytes(before)
    assert damage and damage[0].startswith(SIGNATURE)


def test_missing_list_of_keys_is_named(signed: SignedRelease) -> None:
    signed.signers.unlink()
    assert signed.damage() == [f"signed.sig (no key is trusted: {signed.signers} is missing)"]


def test_missing_ssh_keygen_does_not_pass(signed: SignedRelease, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nonexistent")
    (problem,) = signed.damage()
    assert problem.startswith("signed.sig (cannot be verified: ") and "ssh-keygen" in problem


@pytest.mark.skipif(ME != 0, reason="needs root: chown")
def test_owner_of_a_file_or_folder_above_is_checked(signed: SignedRelease) -> None:
    os.chown(signed.folder / "lib/a.py", 65534, 65534)
    os.chown(signed.folder.parent, 65534, 65534)
    os.chown(signed.signers, 65534, 65534)
    assert signed.damage() == [
        f"{signed.folder.parent} (belongs to user 65534)",
        f"{signed.signers} (belongs to user 65534)",
        "lib/a.py (belongs to user 65534)",
    ]


@pytest.mark.skipif(ME != 0, reason="needs root, to whom releases belong")
def test_program_prints_paths_and_exits_with_1(signed: SignedRelease) -> None:
    # As the units start it: isolated, by a Python that has none of Lupin's packages.
    command = ["/usr/bin/python3", "-I", verify_release.__file__, str(signed.folder), str(signed.signers)]

    def run() -> tuple[int, str, str]:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd="/")
        return done.returncode, done.stdout, done.stderr

    assert run() == (0, "", "")
    (signed.folder / "lib/a.py").write_text("x = 2\n")
    (signed.folder / "lib/\x1b[2J").write_text("")
    status, printed, log = run()
    assert (status, printed.splitlines()) == (1, ["lib/\\x1b[2J (added)", "lib/a.py (changed)"])
    assert log == (
        f"release {ID} is not as it was signed: lib/\\x1b[2J (added) and 1 more; next, on the laptop: lupin deploy robot\n"
    )


@pytest.mark.skipif(ME != 0, reason="needs root, to whom releases belong")
def test_script_of_the_probes_is_fail_safe(signed: SignedRelease, tmp_path: Path) -> None:
    def run(script: str, path: str = os.environ["PATH"]) -> tuple[str, ...]:
        done = subprocess.run(
            ["/bin/sh", "-c", script], env={"PATH": path}, capture_output=True, text=True, timeout=60, check=True
        )
        return parse_damage(done.stdout)

    folder, signers = str(signed.folder), str(signed.signers)
    assert run(verification_script(folder, signers)) == run(verification_script(folder, signers, quick_if="true")) == ()
    empty = tmp_path / "without python3"
    empty.mkdir()
    assert run(verification_script(folder, signers), str(empty)) == (NOT_VERIFIED,)
    (signed.folder / "release.json").unlink()
    assert run(verification_script(folder, signers)) == ("release.json (missing)",)
    assert parse_damage(f"{UNDAMAGED}\n") == ()


def test_verifier_imports_the_standard_library_only() -> None:
    text = Path(verify_release.__file__).read_text(encoding="utf-8")
    imported = {line.split()[1].partition(".")[0] for line in text.splitlines() if line.startswith(("import ", "from "))}
    assert imported <= set(sys.stdlib_module_names)
