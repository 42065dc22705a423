"""Linux namespaces: enter one for a while, start a program in several, and hold new ones open."""

from __future__ import annotations

import ctypes
import os
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# CLONE_NEW* of linux/sched.h. Python has os.setns from 3.12 on.
NEW_FLAGS = {"mnt": 0x00020000, "uts": 0x04000000, "ipc": 0x08000000, "pid": 0x20000000, "net": 0x40000000}
NSENTER_OPTIONS = {"mnt": "--mount", "ipc": "--ipc", "uts": "--uts"}
_libc = ctypes.CDLL(None, use_errno=True)

CLEAN_ENVIRONMENT = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL": "C.UTF-8", "HOME": "/root"}


def enter(fd: int, kind: str) -> None:
    """Move this thread into a namespace; for "pid", only its future children. Raises OSError."""
    if _libc.setns(fd, NEW_FLAGS[kind]):
        number = ctypes.get_errno()
        raise OSError(number, f"setns into another {kind} namespace: {os.strerror(number)}")


@contextmanager
def inside_namespace(fd: int, kind: str) -> Iterator[None]:
    """Inside the block, this thread and the threads it starts are in the namespace. Other threads are not affected."""
    name = "pid_for_children" if kind == "pid" else kind
    original = os.open(f"/proc/thread-self/ns/{name}", os.O_RDONLY | os.O_CLOEXEC)
    try:
        enter(fd, kind)
        try:
            yield
        finally:
            try:
                enter(original, kind)
            except OSError:
                os.abort()  # continuing in the wrong namespace could change the real network of this machine
    finally:
        os.close(original)


def popen_in(
    namespaces: Mapping[str, int], command: Sequence[str], env: Mapping[str, str] | None, **options: Any
) -> subprocess.Popen[Any]:
    """Start a program in namespaces, given as open descriptors by kind. The program is a child of this process."""
    # The child inherits the network and PID namespaces from this thread. nsenter joins the others and then execs the program.
    joined = {kind: fd for kind, fd in namespaces.items() if kind in NSENTER_OPTIONS}
    nsenter = ["nsenter", *(f"{NSENTER_OPTIONS[kind]}=/proc/self/fd/{fd}" for kind, fd in joined.items())]
    nsenter += [f"--wdns={options.pop('cwd', None) or Path.cwd()}", "--", *command]
    with inside_namespace(namespaces["net"], "net"), inside_namespace(namespaces["pid"], "pid"):
        return subprocess.Popen(nsenter, env=env, pass_fds=(*joined.values(), *options.pop("pass_fds", ())), **options)


def hold_new_namespaces(*kinds: str) -> subprocess.Popen[bytes]:
    """Start a process that only keeps new namespaces of these kinds alive. It prints a line when it has them.

    With "pid" it is the first process of its PID namespace.
    """
    options = {"net": "--net", "mnt": "--mount", "ipc": "--ipc", "uts": "--uts"}
    command = ["unshare", *(options[kind] for kind in kinds if kind != "pid")]
    if "pid" in kinds:
        command += ["--pid", "--fork", "--kill-child=SIGKILL", "--mount-proc"]
    # Ignored signals stay ignored across exec, and the kernel reaps the orphans of a first process that ignores SIGCHLD.
    return subprocess.Popen(
        [*command, "sh", "-c", "trap '' CHLD; echo ready; exec sleep infinity"],
        env=CLEAN_ENVIRONMENT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
    )
