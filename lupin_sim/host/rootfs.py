"""The robot's root file system: built once by mmdebstrap, packed, and kept under the hash of its recipe."""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).parent
PACKAGES = (
    *("systemd", "systemd-sysv", "libpam-systemd", "dbus", "udev", "kmod"),
    *("openssh-server", "sudo", "chrony", "python3", "procps", "netbase", "zstd"),
    *("iproute2", "iputils-ping", "nftables", "tcpdump", "iw", "ethtool"),
)
# No languages and no manuals: a fifth of the size.
OPTIONS = (
    *('--aptopt=Acquire::Languages "none"', '--aptopt=APT::Install-Recommends "false"'),
    *("--dpkgopt=path-exclude=/usr/share/man/*", "--dpkgopt=path-exclude=/usr/share/locale/*"),
    *("--dpkgopt=path-exclude=/usr/share/doc/*", "--dpkgopt=path-include=/usr/share/doc/*/copyright"),
)
TAR = ("tar", "--numeric-owner", "--xattrs", "--xattrs-include=*")  # without them ping loses its capability
BUILD_LIMIT_S = 900.0

Progress = Callable[[str], None]


class RootError(Exception):
    """The root file system cannot be had; the message says what to do."""


def cache_directory() -> Path:
    """Where roots and keys are kept: $XDG_CACHE_HOME/lupin-host, or /var/cache/lupin-host."""
    return Path(os.environ.get("XDG_CACHE_HOME") or "/var/cache") / "lupin-host"


def release() -> dict[str, str]:
    """This machine's /etc/os-release."""
    lines = Path("/etc/os-release").read_text().splitlines()
    return dict(line.replace('"', "").split("=", 1) for line in lines if "=" in line)


def suite() -> str:
    """The robot gets the machine's own release, so that the machine's Python runs in there too."""
    return os.environ.get("LUPIN_HOST_SUITE") or release().get("VERSION_CODENAME", "bookworm")


def key() -> str:
    """The hash of all that decides what the root is."""
    recipe = "\n".join((suite(), *PACKAGES, *OPTIONS, (HERE / "recipe.sh").read_text()))
    return hashlib.sha256(recipe.encode()).hexdigest()[:16]


def cached_root() -> Path | None:
    """The unpacked root of the current recipe, where there is one."""
    root = cache_directory() / f"root-{key()}"
    return root if root.is_dir() else None


def root_directory(progress: Progress = lambda _: None) -> Path:
    """The unpacked root, built or unpacked first where it has to be. Raises RootError."""
    if found := cached_root():
        return found
    cache = cache_directory()
    cache.mkdir(parents=True, exist_ok=True)
    with _locked(cache, progress):
        if found := cached_root():
            return found
        _sweep(cache)
        # Everything happens in a folder that no one looks into; the rename at the end is what makes it a root.
        work = cache / f".building-{os.getpid()}"
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir()
        try:
            packed = cache / f"root-{key()}.tar.zst"
            if not (packed.exists() and _unpack(packed, work / "root", progress)):
                _build(work / "root", progress)
                progress("packing it for the next time")
                _call([*TAR, "-I", "zstd -T0 -3", "-C", str(work / "root"), "-cf", str(work / "packed"), "."], progress)
                os.sync()
                (work / "packed").rename(packed)
            root = cache / f"root-{key()}"
            (work / "root").rename(root)
            return root
        finally:
            shutil.rmtree(work, ignore_errors=True)


def _unpack(packed: Path, root: Path, progress: Progress) -> bool:
    """Whether the packed root was whole; what is left of a damaged one is removed."""
    progress(f"unpacking the robot's root ({packed.stat().st_size >> 20} MB)")
    root.mkdir()
    try:
        _call([*TAR, "--zstd", "-C", str(root), "-xf", str(packed)], progress)
    except RootError as error:
        progress(f"the packed root is damaged and will be built anew: {str(error).splitlines()[-1].strip()}")
        packed.unlink()
        shutil.rmtree(root)
        return False
    return True


def _build(root: Path, progress: Progress) -> None:
    if release().get("ID") != "debian" and "LUPIN_HOST_MIRROR" not in os.environ:
        raise RootError(
            f"the robot's root is a Debian like this machine, and this is {release().get('PRETTY_NAME', 'another')}: set "
            "LUPIN_HOST_SUITE (bookworm) and LUPIN_HOST_MIRROR (a Debian mirror)"
        )
    progress(f"building the robot's root, Debian {suite()}, {len(PACKAGES)} packages and what they need: about a minute, once")
    hook = f'--customize-hook=sh {HERE / "recipe.sh"} "$1"'
    command = ["mmdebstrap", "--mode=root", "--variant=minbase", f"--include={','.join(PACKAGES)}", *OPTIONS, hook, suite()]
    _call([*command, str(root), _mirror()], progress)


def _mirror() -> str:
    """The mirror that this machine itself uses."""
    if mirror := os.environ.get("LUPIN_HOST_MIRROR"):
        return mirror
    # What an update would fetch: known before the first one, too.
    uris = subprocess.run(["apt-get", "--print-uris", "update"], capture_output=True, text=True, timeout=60, check=False).stdout
    found = re.search(rf"'(\S+)/dists/{re.escape(suite())}/", uris)
    if found is None:
        raise RootError(
            f"this machine's apt knows no mirror of {suite()}: set LUPIN_HOST_MIRROR, or look into /etc/apt/sources.list"
        )
    return found[1]


def _call(command: list[str], progress: Progress) -> None:
    """Run a step, pass its headlines on, and say how it ended if badly."""
    environment = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8", "TMPDIR": str(cache_directory())}
    environment |= {name: value for name, value in os.environ.items() if name.lower().endswith("_proxy")}
    last: list[str] = []
    with subprocess.Popen(
        ["timeout", f"{BUILD_LIMIT_S:g}", *command],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            last = [*last[-14:], line.rstrip()]
            if line.startswith("I: "):
                progress("  " + line[3:].rstrip())
    if process.returncode:
        raise RootError(f"{command[0]} ended with {process.returncode}; its last words:\n  " + "\n  ".join(last))


@contextmanager
def _locked(cache: Path, progress: Progress) -> Iterator[None]:
    """One builder at a time; others wait and then find the root."""
    with (cache / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            progress("another process builds the robot's root: waiting for it")
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _sweep(cache: Path) -> None:
    """What builders left that were killed: only one holds the lock, so none of it is in use."""
    for left in cache.glob(".building-*"):
        shutil.rmtree(left, ignore_errors=True)
