"""The root file system of simulated computers: built once by mmdebstrap, packed, and cached under the hash of its recipe."""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).parent
PACKAGES = (
    *("systemd", "systemd-sysv", "libpam-systemd", "dbus", "udev", "kmod"),
    *("openssh-server", "sudo", "chrony", "python3", "procps", "netbase", "zstd"),
    *("iproute2", "iputils-ping", "nftables", "tcpdump", "iw", "ethtool"),
)
# Without languages and manuals the root is a fifth of the size.
OPTIONS = (
    *('--aptopt=Acquire::Languages "none"', '--aptopt=APT::Install-Recommends "false"'),
    *("--dpkgopt=path-exclude=/usr/share/man/*", "--dpkgopt=path-exclude=/usr/share/locale/*"),
    *("--dpkgopt=path-exclude=/usr/share/doc/*", "--dpkgopt=path-include=/usr/share/doc/*/copyright"),
)
TAR = ("tar", "--numeric-owner", "--xattrs", "--xattrs-include=*")  # without extended attributes ping loses its capability
BUILD_TIMEOUT_S = 900.0

Progress = Callable[[str], None]


class RootError(Exception):
    """The root file system cannot be built; the message says what to do."""


def cache_directory() -> Path:
    """Return the folder of roots and keys: $XDG_CACHE_HOME/lupin-host, or /var/cache/lupin-host."""
    return Path(os.environ.get("XDG_CACHE_HOME") or "/var/cache") / "lupin-host"


def os_release() -> dict[str, str]:
    """Return the fields of this machine's /etc/os-release."""
    lines = Path("/etc/os-release").read_text().splitlines()
    return dict(line.replace('"', "").split("=", 1) for line in lines if "=" in line)


def suite() -> str:
    """Return the Debian suite of the root: this machine's own, so that this machine's Python runs on the robot too."""
    return os.environ.get("LUPIN_HOST_SUITE") or os_release().get("VERSION_CODENAME", "bookworm")


def recipe_hash() -> str:
    """Return the hash of everything that the content of the root depends on."""
    recipe = "\n".join((suite(), *PACKAGES, *OPTIONS, (HERE / "recipe.sh").read_text()))
    return hashlib.sha256(recipe.encode()).hexdigest()[:16]


def cached_root() -> Path | None:
    """Return the unpacked root of the current recipe, or None."""
    root = cache_directory() / f"root-{recipe_hash()}"
    return root if root.is_dir() else None


def root_directory(progress: Progress = lambda _: None) -> Path:
    """Return the unpacked root; unpack or build it first if necessary. Raises RootError."""
    if found := cached_root():
        return found
    cache = cache_directory()
    cache.mkdir(parents=True, exist_ok=True)
    with _locked(cache, progress):
        if found := cached_root():
            return found
        _remove_stale_builds(cache)
        # The root is built in a folder that nothing else reads; the rename at the end publishes it.
        work = cache / f".building-{os.getpid()}"
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir()
        try:
            packed = cache / f"root-{recipe_hash()}.tar.zst"
            if not (packed.exists() and _unpack(packed, work / "root", progress)):
                _build(work / "root", progress)
                progress("packing it into the cache")
                _call([*TAR, "-I", "zstd -T0 -3", "-C", str(work / "root"), "-cf", str(work / "packed"), "."], progress)
                os.sync()
                (work / "packed").rename(packed)
            root = cache / f"root-{recipe_hash()}"
            (work / "root").rename(root)
            return root
        finally:
            shutil.rmtree(work, ignore_errors=True)


def _unpack(packed: Path, root: Path, progress: Progress) -> bool:
    """Unpack into `root`. Returns False for a damaged archive, after removing it and what was unpacked."""
    progress(f"unpacking the robot's root ({packed.stat().st_size >> 20} MB)")
    root.mkdir()
    try:
        _call([*TAR, "--zstd", "-C", str(root), "-xf", str(packed)], progress)
    except RootError as error:
        progress(f"the packed root is damaged and will be rebuilt: {str(error).splitlines()[-1].strip()}")
        packed.unlink()
        shutil.rmtree(root)
        return False
    return True


def _build(root: Path, progress: Progress) -> None:
    if os_release().get("ID") != "debian" and "LUPIN_HOST_MIRROR" not in os.environ:
        raise RootError(
            "the root has this machine's Debian release, and this machine runs "
            f"{os_release().get('PRETTY_NAME', 'something else')}: set "
            "LUPIN_HOST_SUITE (bookworm) and LUPIN_HOST_MIRROR (a Debian mirror)"
        )
    progress(
        f"building the robot's root, Debian {suite()}, {len(PACKAGES)} packages and what they need: two to five minutes, once"
    )
    hook = f'--customize-hook=sh {HERE / "recipe.sh"} "$1"'
    command = ["mmdebstrap", "--mode=root", "--variant=minbase", f"--include={','.join(PACKAGES)}", *OPTIONS, hook, suite()]
    _call([*command, str(root), _mirror()], progress)


def _mirror() -> str:
    """Return the Debian mirror of this machine. Raises RootError."""
    if mirror := os.environ.get("LUPIN_HOST_MIRROR"):
        return mirror
    # The URIs that an update would fetch; apt knows them before the first update, too.
    uris = subprocess.run(["apt-get", "--print-uris", "update"], capture_output=True, text=True, timeout=60, check=False).stdout
    found = re.search(rf"'(\S+)/dists/{re.escape(suite())}/", uris)
    if found is None:
        raise RootError(
            f"apt on this machine has no mirror of {suite()}: set LUPIN_HOST_MIRROR, or check /etc/apt/sources.list"
        )
    return found[1]


def _call(command: list[str], progress: Progress) -> None:
    """Run a command and pass its progress lines on. Raises RootError with its last lines if it fails."""
    environment = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8", "TMPDIR": str(cache_directory())}
    environment |= {name: value for name, value in os.environ.items() if name.lower().endswith("_proxy")}
    last_lines: list[str] = []
    with subprocess.Popen(
        ["timeout", f"{BUILD_TIMEOUT_S:g}", *command],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            last_lines = [*last_lines[-14:], line.rstrip()]
            if line.startswith("I: "):
                progress("  " + line[3:].rstrip())
    if process.returncode:
        raise RootError(f"{command[0]} exited with status {process.returncode}; its last lines:\n  " + "\n  ".join(last_lines))


@contextmanager
def _locked(cache: Path, progress: Progress) -> Iterator[None]:
    """Hold the lock of the cache: only one process builds, and the others wait. Raises RootError after BUILD_TIMEOUT_S."""
    path = cache / "lock"
    # Only root may open it: whoever can open a file can hold its lock.
    lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        os.fchmod(lock, 0o600)
        deadline_s = time.monotonic() + BUILD_TIMEOUT_S
        waits = False
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline_s:
                    message = f"another process has held {path} for {BUILD_TIMEOUT_S:g} s; see: fuser {path}"
                    raise RootError(message) from None
            if not waits:
                waits = True
                progress("another process builds the root: waiting for it")
            time.sleep(0.2)
        yield
    finally:
        os.close(lock)


def _remove_stale_builds(cache: Path) -> None:
    """Remove the folders of killed builders. The caller holds the lock, so none of them is in use."""
    for folder in cache.glob(".building-*"):
        shutil.rmtree(folder, ignore_errors=True)
