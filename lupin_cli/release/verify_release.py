"""Verifies a release on the robot: its signature, and every file and link in it.

    verify-release FOLDER [SIGNERS]           print what differs from what was signed, one path a line; exit 1 if anything does
    verify-release --quick FOLDER [SIGNERS]   ... but read only files that have another modification time than a deploy's
    verify-release --record FOLDER            print the digests of what the manifest does not list: the content of `built`

A release has four files about itself. `manifest` lists the files that were sent, and `built` what the robot made from them,
both in the format of sha256sum; the digest of a link is that of its target. `signed` has the release's id and the digests of
both lists, and `signed.sig` is its signature, as made by `ssh-keygen -Y sign`.

A deploy installs this file on the robot, as root and outside of all releases, so that no release vouches for itself. It needs
Python 3.8 and the ssh-keygen of OpenSSH 8.1, and imports nothing else of Lupin.
"""

from __future__ import annotations

import hashlib
import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

SIGNERS = "/etc/lupin/release-signers"  # the trusted keys, in the format of ssh-keygen(1), ALLOWED SIGNERS
SIGNER, NAMESPACE = "lupin", "lupin-release"
MANIFEST, BUILT, SIGNED, SIGNATURE = ABOUT = ("manifest", "built", "signed", "signed.sig")
UNSIGNED = f"{SIGNED} (missing)"  # the only problem of a release from before releases were signed
MAX_LINES = 200
_CHUNK_BYTES = 1 << 20
_DIGEST_DIGITS = 64
_SIGNATURE_TIMEOUT_S = 10.0
_DEPLOYED_BEFORE_S = 86400.0  # a deploy gives all files the modification time 0


def statement(release: str, manifest: bytes, built: bytes) -> bytes:
    """Return the text that is signed for a release."""
    digests = (hashlib.sha256(content).hexdigest() for content in (manifest, built))
    return "release {}\nmanifest {}\nbuilt {}\n".format(release, *digests).encode()


def find_damage(folder: str, signers: str = SIGNERS, *, quick: bool = False, owner: int = 0) -> Iterator[str]:
    """Yield what differs from what was signed: a path in the release, with the reason in parentheses.

    With `quick`, the content of a file counts as unchanged if its modification time is that of a deploy. `owner` is the user to
    whom everything must belong, besides root. Raises OSError if a folder cannot be read.
    """
    root, trusted = Path(folder).resolve(), Path(signers)
    if not root.is_dir():
        yield f"{root} (missing)"
        return
    about = {name: _read(root / name) for name in ABOUT}
    signed = about[SIGNED]
    if signed is None:
        yield UNSIGNED
        return
    for path in (root, *root.parents, trusted.resolve()):
        if path.exists() and (problem := _protection_problem(path.stat(), owner)):
            yield f"{path} ({problem})"
    if problem := _signature_problem(signed, root / SIGNATURE, trusted):
        yield f"{SIGNATURE} ({problem})"
        return
    if signed.split(b"\n")[0] != f"release {root.name}".encode():
        yield f"{SIGNED} (of another release)"
        return
    lists = {name: about[name] or b"" for name in (MANIFEST, BUILT)}
    expected = statement(root.name, *lists.values()).split(b"\n")
    for name, line, signed_line in zip(lists, expected[1:], signed.split(b"\n")[1:]):
        if line != signed_line:
            yield f"{name} ({'missing' if about[name] is None else 'changed'})"
            return
    if signed.split(b"\n") != expected:
        yield f"{SIGNED} (malformed)"
        return
    wanted = {path: digest for listing in lists.values() for path, digest in _digests(listing).items()}
    yield from _differences(root, wanted, quick, owner)


def record(folder: str) -> str:
    """Return the digests of all files and links that the manifest does not list. Raises OSError."""
    root = Path(folder)
    listed = _digests((root / MANIFEST).read_bytes())
    found = {path: _digest(entry) for path, entry in _entries(root) if path not in listed and not _is_folder(entry)}
    return "".join(f"{found[path]}  {path}\n" for path in sorted(found, key=os.fsencode))


def _differences(root: Path, wanted: dict[str, str], quick: bool, owner: int) -> Iterator[str]:
    missing = set(wanted)
    for path, entry in _entries(root):
        try:
            found = entry.stat(follow_symlinks=False)
            if problem := _protection_problem(found, owner):
                yield f"{path} ({problem})"
            if _is_folder(entry):
                continue
            missing.discard(path)
            as_deployed = quick and stat.S_ISREG(found.st_mode) and found.st_mtime < _DEPLOYED_BEFORE_S
            if path not in wanted:
                yield f"{path} (added)"
            elif not as_deployed and _digest(entry) != wanted[path]:
                yield f"{path} (changed)"
        except OSError as error:  # a sector of the disk that cannot be read
            yield f"{path} (not readable: {error.strerror})"
    yield from (f"{path} (missing)" for path in sorted(missing))


def _entries(root: Path, below: str = "") -> Iterator[tuple[str, os.DirEntry[str]]]:
    """Yield every file, link and folder of a release with its path, except the files about the release."""
    with os.scandir(root / below) as scan:
        entries = sorted(scan, key=lambda entry: entry.name)
    for entry in entries:
        path = below + entry.name
        if path in ABOUT:
            continue
        yield path, entry
        if _is_folder(entry):
            yield from _entries(root, f"{path}/")


def _is_folder(entry: os.DirEntry[str]) -> bool:
    return entry.is_dir(follow_symlinks=False)


def _digest(entry: os.DirEntry[str]) -> str:
    """Return the SHA-256 of a file's content or of a link's target; empty for anything else, which is not opened."""
    digest = hashlib.sha256()
    if entry.is_symlink():
        digest.update(os.fsencode(os.readlink(entry.path)))  # noqa: PTH115 -- a Path would normalize it
    elif entry.is_file(follow_symlinks=False):
        with Path(entry.path).open("rb") as file:
            while chunk := file.read(_CHUNK_BYTES):
                digest.update(chunk)
    else:
        return ""
    return digest.hexdigest()


def _digests(listing: bytes) -> dict[str, str]:
    """Return the digests in a list, by path."""
    lines = os.fsdecode(listing).split("\n")
    return {line[_DIGEST_DIGITS + 2 :]: line[:_DIGEST_DIGITS] for line in lines if line}


def _read(path: Path) -> bytes | None:
    """Return the content of a file; None if it is missing, not a regular file, or not readable."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    with os.fdopen(descriptor, "rb") as file:
        try:
            return file.read() if stat.S_ISREG(os.fstat(descriptor).st_mode) else None
        except OSError:
            return None


def _protection_problem(found: os.stat_result, owner: int) -> str:
    """Return why another user may change a file, or what is in a folder; empty if none may."""
    if found.st_uid not in (0, owner):
        return f"belongs to user {found.st_uid}"
    shared = stat.S_ISDIR(found.st_mode) and found.st_mode & stat.S_ISVTX  # like /tmp, where nobody replaces others' files
    if not stat.S_ISLNK(found.st_mode) and found.st_mode & 0o022 and not shared:
        return f"other users may change it: mode {stat.S_IMODE(found.st_mode):04o}"
    return ""


def _signature_problem(text: bytes, signature: Path, signers: Path) -> str:
    """Return why no trusted key has signed `text`; empty if one has."""
    if not signature.exists():
        return "missing"
    if not signers.exists():
        return f"no key is trusted: {signers} is missing"
    command = ["ssh-keygen", "-Y", "verify", "-f", str(signers), "-I", SIGNER, "-n", NAMESPACE, "-s", str(signature)]
    try:
        done = subprocess.run(command, input=text, capture_output=True, timeout=_SIGNATURE_TIMEOUT_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"cannot be verified: {error}"
    if done.returncode == 0:
        return ""
    reasons = done.stderr.decode("utf-8", "replace").splitlines()
    return f"not valid: {reasons[-1].strip()}" if reasons else f"made by a key that is not in {signers}"


def main(arguments: list[str]) -> int:
    """Verify or record a release; return the exit status."""
    options, arguments = [each for each in arguments if each.startswith("--")], [each for each in arguments if each[:2] != "--"]
    if "--record" in options:
        sys.stdout.buffer.write(os.fsencode(record(arguments[0])))
        return 0
    try:
        damage = list(find_damage(*arguments[:2], quick="--quick" in options))
    except OSError as error:
        damage = [f"{error.filename} (not readable: {error.strerror})"]
    lines = [line if line.isprintable() else line.encode("unicode_escape").decode() for line in damage]
    for line in lines[:MAX_LINES]:
        print(line)
    if lines:
        name, more = Path(arguments[0]).resolve().name, f" and {len(lines) - 1} more" if len(lines) > 1 else ""
        print(
            f"release {name} is not as it was signed: {lines[0]}{more}; next, on the laptop: lupin deploy robot",
            file=sys.stderr,
        )
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
