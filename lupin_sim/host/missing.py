"""What this machine lacks for booting a robot, in one line."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from lupin_sim.host.rootfs import cached_root

# Program: the Debian package that brings it.
PROGRAMS = {
    "systemd-nspawn": "systemd-container",
    "ip": "iproute2",
    "nsenter": "util-linux",
    "unshare": "util-linux",
    "ssh": "openssh-client",
    "ssh-keygen": "openssh-client",
    "gcc": "gcc",
}
BUILDERS = {"mmdebstrap": "mmdebstrap", "zstd": "zstd", "tar": "tar", "apt-get": "apt"}
SEARCHED = "/usr/sbin:/usr/bin:/sbin:/bin"


def what_is_missing() -> str | None:
    """None where a robot can be booted here; otherwise what is missing, and what to type."""
    if not sys.platform.startswith("linux"):
        return "a robot's computer boots on Linux only: its namespaces are the robot"
    if os.geteuid() != 0:
        return "a robot's computer needs root here, for namespaces and mounts: run it as root (sudo -E)"
    wanted = PROGRAMS if cached_root() else PROGRAMS | BUILDERS
    absent = [name for name in wanted if shutil.which(name, path=SEARCHED) is None]
    if absent:
        packages = sorted({wanted[name] for name in absent})
        return f"this machine lacks {', '.join(absent)}: apt-get install {' '.join(packages)}"
    if not cgroup_roots():
        return "this machine has no cgroups that systemd could use: mount cgroup2 on /sys/fs/cgroup"
    command = [
        "unshare",
        "--mount",
        "--pid",
        "--net",
        "--ipc",
        "--uts",
        "--time",
        "--fork",
        "mount",
        "-t",
        "tmpfs",
        "tmpfs",
        "/mnt",
    ]
    tried = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    if tried.returncode:
        return f"this machine allows no namespaces ({tried.stderr.strip()}): a container needs --privileged, or use a machine"
    return None


def cgroup_roots() -> list[Path]:
    """Where this machine's systemd-capable hierarchies are: one with cgroup v2, two where v1 and v2 live side by side."""
    base = Path("/sys/fs/cgroup")
    if (base / "cgroup.controllers").exists():
        return [base]
    return [base / name for name in ("systemd", "unified") if (base / name / "cgroup.procs").exists()]
