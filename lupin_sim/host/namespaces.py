"""Standing in another namespace: the system calls, and a process that holds some."""

from __future__ import annotations

import ctypes
import os
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# linux/sched.h. Python has os.setns from 3.12 on.
NEW_FLAGS = {"mnt": 0x00020000, "uts": 0x04000000, "ipc": 0x08000000, "pid": 0x20000000, "net": 0x40000000}
NSENTER_OPTIONS = {"mnt": "--mount", "ipc": "--ipc", "uts": "--uts"}
_libc = ctypes.CDLL(None, use_errno=True)

CLEAN_ENVIRONMENT = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8", "HOME": "/root"}


def enter(fd: int, kind: str) -> None:
    """This thread goes over into a namespace; for "pid" only the children it makes from then on do."""
    if _libc.setns(fd, NEW_FLAGS[kind]):
        number = ctypes.get_errno()
        raise OSError(number, f"setns into another {kind} namespace: {os.strerror(number)}")


@contextmanager
def standing_in(fd: int, kind: str) -> Iterator[None]:
    """This thread, and the threads it starts, are in the namespace inside the block. Other threads stay where they are."""
    name = "pid_for_children" if kind == "pid" else kind
    back = os.open(f"/proc/thread-self/ns/{name}", os.O_RDONLY | os.O_CLOEXEC)
    try:
        enter(fd, kind)
        try:
            yield
        finally:
            try:
                enter(back, kind)
            except OSError:
                os.abort()  # going on in the wrong namespace could change the machine's own network
    finally:
        os.close(back)


def popen_in(
    namespaces: Mapping[str, int], command: Sequence[str], env: Mapping[str, str] | None, **options: Any
) -> subprocess.Popen[Any]:
    """Start a program in namespaces given as open descriptors by kind. It is a child of this process."""
    # The network and the PID namespace this thread lends to its child; the others nsenter joins, and then becomes the program.
    joined = {kind: fd for kind, fd in namespaces.items() if kind in NSENTER_OPTIONS}
    enter = ["nsenter", *(f"{NSENTER_OPTIONS[kind]}=/proc/self/fd/{fd}" for kind, fd in joined.items())]
    enter += [f"--wdns={options.pop('cwd', None) or Path.cwd()}", "--", *command]
    with standing_in(namespaces["net"], "net"), standing_in(namespaces["pid"], "pid"):
        return subprocess.Popen(enter, env=env, pass_fds=(*joined.values(), *options.pop("pass_fds", ())), **options)


def new_namespaces(*kinds: str) -> subprocess.Popen[bytes]:
    """A process that does nothing but hold new namespaces of these kinds. In a PID namespace it is the first one."""
    options = {"net": "--net", "mnt": "--mount", "ipc": "--ipc", "uts": "--uts"}
    command = ["unshare", *(options[kind] for kind in kinds if kind != "pid")]
    if "pid" in kinds:
        command += ["--pid", "--fork", "--kill-child=SIGKILL", "--mount-proc"]
    # Ignored signals stay ignored over exec, and a first process that ignores SIGCHLD has its orphans reaped by the kernel.
    return subprocess.Popen(
        [*command, "sh", "-c", "trap '' CHLD; echo here; exec sleep infinity"],
        env=CLEAN_ENVIRONMENT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
    )
