"""What this machine lacks for booting a simulated computer, in one line."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from lupin_sim.host.rootfs import cached_root

# Programs with the Debian packages that contain them.
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
SEARCH_PATH = "/usr/sbin:/usr/bin:/sbin:/bin"


def missing_prerequisite() -> str | None:
    """Return what is missing on this machine and what to type; None if it can boot a simulated computer."""
    if not sys.platform.startswith("linux"):
        return "a simulated computer boots on Linux only: it consists of namespaces"
    if os.geteuid() != 0:
        return "a simulated computer needs root here, for namespaces and mounts: run it as root (sudo -E)"
    wanted = PROGRAMS if cached_root() else PROGRAMS | BUILDERS
    absent = [name for name in wanted if shutil.which(name, path=SEARCH_PATH) is None]
    if absent:
        packages = sorted({wanted[name] for name in absent})
        return f"this machine lacks {', '.join(absent)}: apt-get install {' '.join(packages)}"
    if not cgroup_roots():
        return "this machine has no cgroups that systemd can use: mount cgroup2 on /sys/fs/cgroup"
    namespaces = ["--mount", "--pid", "--net", "--ipc", "--uts", "--time"]
    command = ["unshare", *namespaces, "--fork", "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
    tried = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    if tried.returncode:
        return (
            f"this machine allows no new namespaces ({tried.stderr.strip()}): start the container with --privileged, "
            "or use a machine without a container"
        )
    return None


def cgroup_roots() -> list[Path]:
    """Return the cgroup hierarchies that systemd can use: one with cgroup v2 alone, two if v1 and v2 are mounted together."""
    base = Path("/sys/fs/cgroup")
    if (base / "cgroup.controllers").exists():
        return [base]
    return [base / name for name in ("systemd", "unified") if (base / name / "cgroup.procs").exists()]
