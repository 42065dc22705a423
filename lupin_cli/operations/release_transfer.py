"""Transfers a release to a robot, completely or not at all.

Below `/opt/lupin`, which belongs to root, a robot has `releases/<id>/`, complete, signed and never changed again; `current` and
`previous`, symbolic links that are replaced atomically; and `incoming/<id>/`, where a release is received, built, signed and
verified. After an interruption the next deploy continues there. Nothing below `incoming` is ever run.
"""

from __future__ import annotations

import hashlib
import io
import shlex
import tarfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lupin_cli.connection.base import Output, Target
from lupin_cli.connection.shell_file_io import SAFE_PATHS
from lupin_cli.operations.base import OperationError
from lupin_cli.operations.shell import change, query
from lupin_cli.release.contents import RobotPlatform
from lupin_cli.release.manifest import Entry, Manifest
from lupin_cli.release.paths import ROOT
from lupin_cli.release.signing_key import SigningKey
from lupin_cli.release.verification import parse_damage, verification_script, verifier_script
from lupin_cli.release.verify_release import BUILT, SIGNERS, UNSIGNED, statement

CHUNK_BYTES = 8_000_000
KEPT_RELEASES = 3
HEADROOM_BYTES = 50_000_000
DEPLOY = "lupin deploy robot"
DIGEST_TIMEOUT_S = 60.0  # an SD card reads a release in a few seconds


@dataclass(frozen=True)
class InstalledReleases:
    """The releases on a robot, and the properties of the robot that matter for a deploy."""

    robot: RobotPlatform
    current: str  # its id; empty if there is none
    previous: str
    releases: tuple[str, ...]
    free_bytes: int
    read_only: bool = False  # whether the file system is read-only


_PROBE = """
uname -m
python3 -I -c 'import sys; print(*sys.version_info[:2])' 2>/dev/null || echo 0 0
ls /opt/ros 2>/dev/null | tail -n 1 | grep . || echo -
basename "$(readlink {root}/current || echo -)"
basename "$(readlink {root}/previous || echo -)"
(ls {root}/releases 2>/dev/null || true) | tr '\\n' ' '; echo
df -Pk "$(test -d {root} && echo {root} || echo /opt)" | awk 'NR == 2 {{print $4}}'
findmnt -nro OPTIONS -T "$(test -d {root} && echo {root} || echo /opt)" 2>/dev/null || echo unknown
"""


def installed_script(root: str = ROOT) -> str:
    """Return the probe whose output `parse_installed` reads."""
    return _PROBE.format(root=root)


def read_installed(target: Target, root: str = ROOT) -> InstalledReleases:
    """Probe the releases on a robot. Raises OperationError if the output cannot be parsed."""
    return parse_installed(query(target, installed_script(root)))


def parse_installed(output: Output) -> InstalledReleases:
    """Read the output of `installed_script`. Raises OperationError."""
    lines = output.stdout.splitlines()
    try:
        if not output.ok or len(lines) != 8:
            raise ValueError("expected eight lines")
        major, minor = map(int, lines[1].split())
        free_bytes = int(lines[6]) * 1024
    except ValueError as error:
        reason = _last_line(output) if not output.ok else f"found {output.stdout[:80]!r}"
        raise OperationError(f"could not read which releases the robot has: {reason}", "lupin doctor") from error
    if not major:
        raise OperationError("the robot has no python3", "sudo apt install python3")
    names = ["" if line == "-" else line for line in lines[2:5]]
    return InstalledReleases(
        robot=RobotPlatform(lines[0], (major, minor), names[0]),
        current=names[1],
        previous=names[2],
        releases=tuple(lines[5].split()),
        free_bytes=free_bytes,
        read_only="ro" in lines[7].split(","),
    )


def current_manifest(target: Target, state: InstalledReleases, root: str = ROOT) -> str:
    """Return the manifest of the robot's current release; empty if there is none. Raises TargetError."""
    text = (target.get(f"{root}/releases/{state.current}/manifest") if state.current else None) or b""
    return text.decode("utf-8", "replace")


def changed_folders(old_manifest: str, manifest: Manifest) -> tuple[list[str], int]:
    """Return how many files differ from the old manifest, a diff line per folder and kind; and the size of the new ones."""
    before = {line[66:]: line[:64] for line in old_manifest.splitlines()}
    after = {entry.path: entry for entry in manifest.entries}
    removed = Counter(_folder(path) for path in before if path not in after or before[path] != after[path].sha256)
    new = [entry for entry in manifest.entries if before.get(entry.path) != entry.sha256]
    added: dict[str, list[int]] = {}
    for entry in new:
        added.setdefault(_folder(entry.path), []).append(entry.size)
    lines = []
    for folder in sorted({*removed, *added}):
        if folder in removed:
            lines.append(f"-{_count(removed[folder])} in {folder}")
        if folder in added:
            lines.append(f"+{_count(len(added[folder]))} in {folder}, {sum(added[folder]) / 1e6:.1f} MB")
    return lines, sum(entry.size for entry in new)


def _count(files: int) -> str:
    return f"{files} file{'' if files == 1 else 's'}"


def _folder(path: str) -> str:
    """Return the folder under which a file is counted: its package, or at most two levels."""
    folders = path.split("/")[:-1]
    depth = folders.index("site-packages") + 2 if "site-packages" in folders else 2
    return "/".join(folders[:depth]) or "."


def find_damage(target: Target, release: str, root: str = ROOT, signers: str = SIGNERS) -> tuple[str, ...]:
    """Return the files of a kept release that are not as they were signed, each with a reason. It reads all of them."""
    script = verification_script(f"{root}/releases/{shlex.quote(release)}", signers)
    return parse_damage(query(target, script, timeout_s=DIGEST_TIMEOUT_S).stdout)


def require_undamaged(target: Target, release: str, root: str = ROOT, signers: str = SIGNERS) -> None:
    """Raise OperationError unless a kept release is as it was signed."""
    damage = find_damage(target, release, root, signers)
    if damage == (UNSIGNED,):
        raise OperationError(
            f"the release {release} on {target.name} is not signed, so nothing shows that it is undamaged; "
            "it was deployed by an earlier version of Lupin",
            DEPLOY,
        )
    if damage:
        raise OperationError(f"the release {release} on {target.name} is damaged: {name_some(damage)}", DEPLOY)


def name_some(paths: Sequence[str]) -> str:
    """Return the first paths, and how many more there are."""
    more = f" and {len(paths) - 3} more" if len(paths) > 3 else ""
    return f"{', '.join(paths[:3])}{more}"


def upload(
    target: Target, state: InstalledReleases, manifest: Manifest, key: SigningKey, root: str = ROOT, signers: str = SIGNERS
) -> None:
    """Put the release below `releases/`, signed with `key`, and verify it, without making it current.

    It replaces a release of that id. The scripts print the progress. Raises OperationError; the files that have arrived are
    kept for the next attempt.
    """
    if state.read_only:
        raise OperationError(
            f"{target.name} has a read-only file system below {root}; nothing was copied, and its current release is unchanged",
            "sudo dmesg | grep -i -e remount -e error | tail",
        )
    _require_room(target, state, 0, root)  # the comparison itself needs space too
    folders = SAFE_PATHS + _FOLDERS.format(root=shlex.quote(root))
    _run(target, folders + _PREPARE.format(root=root, id=manifest.id), "compare the files", stdin=manifest.text().encode())
    missing = set((target.get(f"{root}/incoming/{manifest.id}/.missing") or b"").decode().splitlines())
    wanted = [entry for entry in manifest.entries if entry.path in missing]
    total, sent = sum({entry.sha256: entry.size for entry in wanted}.values()), 0
    _require_room(target, state, total, root)
    for size, archive in _archives(wanted):
        sent += size
        script = f"tar -xzf - -C {root}/incoming/{manifest.id} && echo '{sent / 1e6:.0f} of {total / 1e6:.0f} MB'"
        _run(target, script, "write the files", stdin=archive)
    python = f"python{state.robot.python[0]}.{state.robot.python[1]}"
    record = verifier_script("--record", ".")
    _run(target, _BUILD.format(root=root, id=manifest.id, python=python, record=record), "build the release")
    folder = f"{root}/incoming/{manifest.id}"
    text = statement(manifest.id, manifest.text().encode(), target.get(f"{folder}/{BUILT}") or b"")
    publish = _PUBLISH.format(root=root, id=manifest.id, verify=verifier_script(folder, shlex.quote(signers)))
    _run(target, publish, "verify the release", stdin=text + key.sign(text))


def _require_room(target: Target, state: InstalledReleases, needed_bytes: int, root: str) -> None:
    """Raise OperationError if `needed_bytes` more would fill the robot's disk."""
    if needed_bytes + HEADROOM_BYTES > state.free_bytes:
        raise OperationError(
            f"{target.name} has {state.free_bytes / 1e6:.0f} MB free below {root}; "
            f"the release needs {needed_bytes / 1e6:.0f} MB more, and {HEADROOM_BYTES / 1e6:.0f} MB must stay free",
            "sudo du -xh --max-depth=2 / | sort -h | tail",
        )


def activate(target: Target, release: str, root: str = ROOT) -> None:
    """Atomically make `release` current and the one before it `previous`, and remove old ones; "" only removes `current`."""
    if not release:
        _run(target, f"rm -f {root}/current", "remove the link to the release")
        return
    _run(target, _ACTIVATE.format(root=root, id=shlex.quote(release), keep=KEPT_RELEASES), f"switch to release {release}")


# Earlier versions of Lupin gave these folders to the robot's user.
_FOLDERS = """umask 022
for folder in {root} {root}/releases {root}/incoming; do
  mkdir -p -- "$folder" && enter_folder "$folder/." && chown -- 0:0 . && chmod 755 . || exit 1
done
"""

# Only files of root are used again: whoever owns a file can change it through another link to it.
_PREPARE = """set -eu
umask 022
cd {root}
belongs_to_root() {{ [ -z "$(find "$1" ! -uid 0 -print -quit)" ]; }}
for old in incoming/* incoming/.[!.]*; do
  case $old in incoming/{id}) belongs_to_root "$old" || rm -rf "$old" ;; *) rm -rf "$old" ;; esac
done
if [ ! -d incoming/{id} ]; then
  mkdir incoming/.{id}
  now=releases/$(basename "$(readlink current || echo -)")
  if [ -f "$now/manifest" ] && belongs_to_root "$now"; then cp -al "$now/." incoming/.{id}/; fi
  mv incoming/.{id} incoming/{id}
fi
cd incoming/{id}
cat > .manifest && mv -f .manifest manifest
cut -c67- manifest | LC_ALL=C sort > .wanted
find . -type l -delete
find . -type f ! -path ./manifest ! -path './.[mw]*' -printf '%P\\n' | LC_ALL=C sort | LC_ALL=C comm -23 - .wanted |
  tr '\\n' '\\0' | xargs -0r rm -f
rm -f .wanted
(sha256sum --check --quiet manifest 2>/dev/null || true) | sed 's/: FAILED.*$//' > .missing
"""

# All files of a release have the modification time 0, by which a quick check knows them; so byte code is validated by hash.
_BUILD = """set -eu
umask 022
cd {root}/incoming/{id}
echo 'verifying every file'
sha256sum --check --quiet manifest
rm -f .missing
mkdir -p venv/bin bin
ln -sfn /usr/bin/{python} venv/bin/python3
echo 'compiling to byte code'
venv/bin/python3 -I -m compileall -q -j 0 --invalidation-mode checked-hash venv/lib || true
if [ -d ws/src ]; then
  command -v colcon >/dev/null || {{ echo 'colcon is missing: sudo apt install python3-colcon-common-extensions' >&2; exit 1; }}
  . /opt/ros/*/setup.sh
  echo 'building the interface package, about a minute'
  (cd ws && colcon build --merge-install)
fi
{{
{record}}} > ../.built-{id}
mv -f ../.built-{id} built
find . -type f -newermt 1970-01-02 -exec touch -d @0 -- {{}} +
"""

# Its input is the signed text and the signature. Between the two renames that replace a damaged release, the robot has no such
# release.
_PUBLISH = """set -eu
umask 022
cd {root}/incoming/{id}
cat > ../.signed-{id}
sed '/^-----BEGIN/,$d' ../.signed-{id} > signed
sed -n '/^-----BEGIN/,$p' ../.signed-{id} > signed.sig
rm -f ../.signed-{id}
cd {root}
echo 'verifying the signature'
{verify}echo 'writing to the disk'
sync -f incoming/{id}
if [ -e releases/{id} ]; then mv -T releases/{id} incoming/.damaged-{id}; fi
mv -T incoming/{id} releases/{id}
rm -rf incoming/.damaged-{id}
sync -f releases
"""

_ACTIVATE = """set -eu
cd {root}
new={id}
test -f "releases/$new/manifest" || {{ echo "there is no release $new" >&2; exit 1; }}
old=$(basename "$(readlink current || echo -)")
if [ "$old" != "$new" ]; then
  if [ "$old" != - ]; then ln -sfn "releases/$old" .previous && mv -T .previous previous; fi
  ln -sfn "releases/$new" .current && mv -T .current current
  sync -f .
fi
previous=$(basename "$(readlink previous || echo -)")
ls -t releases | grep -vxF -e "$new" -e "$previous" | tail -n +{keep} | while read -r name; do rm -rf "releases/$name"; done
"""


def _archives(entries: Sequence[Entry]) -> Iterator[tuple[int, bytes]]:
    """Pack the files into archives of about CHUNK_BYTES: yields (bytes of content, archive). Files with equal content are sent
    once; their other paths become hard links."""
    first: dict[str, str] = {}
    buffer, archive, size = io.BytesIO(), None, 0
    for entry in entries:
        if archive is None:
            buffer, size = io.BytesIO(), 0
            archive = tarfile.open(fileobj=buffer, mode="w:gz", compresslevel=1)  # noqa: SIM115 -- closed when it is full
        info = tarfile.TarInfo(entry.path)
        info.mode = 0o755 if entry.executable else 0o644
        if entry.sha256 in first:
            info.type, info.linkname = tarfile.LNKTYPE, first[entry.sha256]
            archive.addfile(info)
            continue
        first[entry.sha256] = entry.path
        data = entry.read()
        if hashlib.sha256(data).hexdigest() != entry.sha256:
            raise OperationError(f"{entry.source!r} changed while the release was built", "lupin deploy robot")
        info.size = len(data)
        archive.addfile(info, io.BytesIO(data))
        size += entry.size
        if size >= CHUNK_BYTES:
            archive.close()
            archive = None
            yield size, buffer.getvalue()
    if archive is not None:
        archive.close()
        yield size, buffer.getvalue()


def _run(target: Target, script: str, what: str, *, stdin: bytes = b"") -> Output:
    return change(target, script, what, root=True, stdin=stdin, timeout_s=300.0, next_command=DEPLOY)


def _last_line(output: Output) -> str:
    lines = (output.stderr or output.stdout).strip().splitlines()
    return lines[-1] if lines else ("no answer in time" if output.status is None else f"status {output.status}")
