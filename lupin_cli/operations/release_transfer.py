"""Transfers a release to a robot, completely or not at all.

Below `/opt/lupin` a robot has `releases/<id>/`, complete and never changed again; `current` and `previous`, symbolic links that
are replaced atomically; and `incoming/<id>/`, where a release is received. After an interruption the next deploy continues
there. Nothing below `incoming` is ever run.
"""

from __future__ import annotations

import hashlib
import io
import shlex
import tarfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lupin_cli.connection.base import Output, Target
from lupin_cli.operations.base import OperationError
from lupin_cli.operations.shell import change, query
from lupin_cli.release.contents import RobotPlatform
from lupin_cli.release.manifest import Entry, Manifest
from lupin_cli.release.paths import ROOT

CHUNK_BYTES = 8_000_000
KEPT_RELEASES = 3
HEADROOM_BYTES = 50_000_000


@dataclass(frozen=True)
class InstalledReleases:
    """The releases on a robot, and the properties of the robot that matter for a deploy."""

    robot: RobotPlatform
    current: str  # its id; empty if there is none
    previous: str
    releases: tuple[str, ...]
    free_bytes: int
    writable: bool  # whether this user can write the releases without root
    read_only: bool = False  # whether the file system is read-only


_PROBE = """
uname -m
python3 -c 'import sys; print(*sys.version_info[:2])' 2>/dev/null || echo 0 0
ls /opt/ros 2>/dev/null | tail -n 1 | grep . || echo -
basename "$(readlink {root}/current || echo -)"
basename "$(readlink {root}/previous || echo -)"
(ls {root}/releases 2>/dev/null || true) | tr '\\n' ' '; echo
df -Pk "$(test -d {root} && echo {root} || echo /opt)" | awk 'NR == 2 {{print $4}}'
test -w {root}/releases && test -w {root}/incoming && echo yes || echo no
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
        if not output.ok or len(lines) != 9:
            raise ValueError("expected nine lines")
        major, minor = map(int, lines[1].split())
        free_bytes = int(lines[6]) * 1024
    except ValueError as error:
        reason = _last_line(output) if not output.ok else f"found {output.stdout[:80]!r}"
        raise OperationError(f"could not read which releases the robot has: {reason}", "lupin doctor") from error
    if not major:
        raise OperationError("the robot has no python3", "sudo apt install python3 (on the robot)")
    names = ["" if line == "-" else line for line in lines[2:5]]
    return InstalledReleases(
        robot=RobotPlatform(lines[0], (major, minor), names[0]),
        current=names[1],
        previous=names[2],
        releases=tuple(lines[5].split()),
        free_bytes=free_bytes,
        writable=lines[7] == "yes",
        read_only="ro" in lines[8].split(","),
    )


def current_manifest(target: Target, state: InstalledReleases, root: str = ROOT) -> str:
    """Return the manifest of the robot's current release; empty if there is none. Raises TargetError."""
    text = (target.get(f"{root}/releases/{state.current}/manifest") if state.current else None) or b""
    return text.decode("utf-8", "replace")


def changed_files(old_manifest: str, manifest: Manifest) -> tuple[list[str], int]:
    """Return the files that differ from the old manifest, one diff line each, and the size of the new ones in bytes."""
    before = {line[66:]: line[:64] for line in old_manifest.splitlines()}
    after = {entry.path: entry for entry in manifest.entries}
    lines = [f"-{path}" for path in before if path not in after or before[path] != after[path].sha256]
    new = [entry for entry in manifest.entries if before.get(entry.path) != entry.sha256]
    lines += [f"+{entry.path}  {entry.size} bytes" for entry in new]
    return sorted(lines, key=lambda line: (line[1:].split("  ")[0], line[0] == "+")), sum(entry.size for entry in new)


def upload(target: Target, state: InstalledReleases, manifest: Manifest, root: str = ROOT) -> None:
    """Put the release below `releases/` and verify it, without making it current. The scripts print the progress.

    Raises OperationError; the files that have arrived are kept for the next attempt.
    """
    if manifest.id in state.releases:
        return
    if state.read_only:
        raise OperationError(
            f"{target.name} has a read-only file system below {root}; nothing was copied, and its current release is unchanged",
            f"ssh {target.name} 'sudo dmesg | grep -i -e remount -e error | tail'",
        )
    _require_room(target, state, 0, root)  # the comparison itself needs space too
    if not state.writable:
        script = f"install -d -o {shlex.quote(target.user)} {root} {root}/releases {root}/incoming"
        _run(target, script, "create the folder of releases", root=True)
    _run(target, _PREPARE.format(root=root, id=manifest.id), "compare the files", stdin=manifest.text().encode())
    missing = set((target.get(f"{root}/incoming/{manifest.id}/.missing") or b"").decode().splitlines())
    wanted = [entry for entry in manifest.entries if entry.path in missing]
    total, sent = sum({entry.sha256: entry.size for entry in wanted}.values()), 0
    _require_room(target, state, total, root)
    for size, archive in _archives(wanted):
        sent += size
        script = f"tar -xzf - -C {root}/incoming/{manifest.id} && echo '{sent / 1e6:.0f} of {total / 1e6:.0f} MB'"
        _run(target, script, "write the files", stdin=archive)
    python = f"python{state.robot.python[0]}.{state.robot.python[1]}"
    _run(target, _FINISH.format(root=root, id=manifest.id, python=python), "verify the release")


def _require_room(target: Target, state: InstalledReleases, needed_bytes: int, root: str) -> None:
    """Raise OperationError if `needed_bytes` more would fill the robot's disk."""
    if needed_bytes + HEADROOM_BYTES > state.free_bytes:
        raise OperationError(
            f"{target.name} has {state.free_bytes / 1e6:.0f} MB free below {root}; "
            f"the release needs {needed_bytes / 1e6:.0f} MB more, and {HEADROOM_BYTES / 1e6:.0f} MB must stay free",
            f"ssh {target.name} 'sudo du -xh --max-depth=2 / | sort -h | tail'",
        )


def activate(target: Target, release: str, root: str = ROOT) -> None:
    """Atomically make `release` current and the one before it `previous`, and remove old ones; "" only removes `current`."""
    if not release:
        _run(target, f"rm -f {root}/current", "remove the link to the release")
        return
    _run(target, _ACTIVATE.format(root=root, id=shlex.quote(release), keep=KEPT_RELEASES), f"switch to release {release}")


_PREPARE = """set -eu
umask 022
cd {root}
for old in incoming/* incoming/.[!.]*; do
  case $old in incoming/{id}) ;; *) rm -rf "$old" ;; esac
done
if [ ! -d incoming/{id} ]; then
  mkdir incoming/.{id}
  if [ -f current/manifest ]; then cp -al "$(readlink -f current)/." incoming/.{id}/; fi
  mv incoming/.{id} incoming/{id}
fi
cd incoming/{id}
cat > .manifest && mv -f .manifest manifest
cut -c67- manifest | LC_ALL=C sort > .wanted
find . -type f ! -name .wanted ! -name .missing ! -name manifest -printf '%P\\n' | LC_ALL=C sort | LC_ALL=C comm -23 - .wanted |
  tr '\\n' '\\0' | xargs -0r rm -f
rm -f .wanted
(sha256sum --check --quiet manifest 2>/dev/null || true) | sed 's/: FAILED.*$//' > .missing
"""

# Byte code is validated by hash, because all files of a release have the same modification time.
_FINISH = """set -eu
umask 022
cd {root}/incoming/{id}
sha256sum --check --quiet manifest
rm -f .missing
mkdir -p venv/bin bin
ln -sfn /usr/bin/{python} venv/bin/python3
venv/bin/python3 -m compileall -q -j 0 --invalidation-mode checked-hash venv/lib || true
if [ -d ws/src ]; then
  command -v colcon >/dev/null || {{ echo 'colcon is missing: sudo apt install python3-colcon-common-extensions' >&2; exit 1; }}
  . /opt/ros/*/setup.sh
  (cd ws && colcon build --merge-install)
fi
sync -f .
cd {root}
if [ -d releases/{id} ]; then rm -rf incoming/{id}; else mv incoming/{id} releases/{id}; fi
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


def _run(target: Target, script: str, what: str, *, root: bool = False, stdin: bytes = b"") -> Output:
    return change(target, script, what, root=root, stdin=stdin, timeout_s=300.0, next_command="lupin deploy robot")


def _last_line(output: Output) -> str:
    lines = (output.stderr or output.stdout).strip().splitlines()
    return lines[-1] if lines else ("no answer in time" if output.status is None else f"status {output.status}")
