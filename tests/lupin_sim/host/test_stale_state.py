"""A host leaves nothing behind however it ends, changes nothing on this machine, and names missing prerequisites."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_sim.host import Host, HostUnavailable, prerequisites, rootfs, state
from lupin_sim.host.host import PROJECT
from lupin_sim.host.prerequisites import cgroup_roots
from tests.support.waiting import wait_until

LUPIN = [sys.executable, "-m", "lupin_cli.app"]


def traces(name: str) -> list[str]:
    """Everything on this machine that still has a host's name: cgroups, mounts, processes, its folder."""
    found = [str(path) for base in cgroup_roots() for path in base.glob(f"*-{name}")]
    found += [line for line in Path("/proc/self/mountinfo").read_text().splitlines() if f"/{name}/" in line]
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            command = path.read_bytes().decode(errors="replace")
        except OSError:
            continue
        if f"/{name}/" in command or f"/{name}\0" in command:
            found.append(command)
    return found + [str(path) for path in (state.STATE / name,) if path.exists()]


KILLED = """
import os, signal
from lupin_sim.host import Host
host = Host.start({name!r})
assert host.ssh("true").returncode == 0
host.popen(["sleep", "1000"])
host.serve_ntp()
host.robot.inject_fault("slow-link")
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.host
def test_killed_starter_leaves_nothing_of_its_host(host: Host, tmp_path: Path) -> None:
    name = f"killed-{tmp_path.parent.name}"
    killed = subprocess.run([sys.executable, "-c", KILLED.format(name=name)], cwd=PROJECT, timeout=90, check=False)
    assert killed.returncode == -9
    daemon = state.read(state.STATE / name)
    assert daemon is not None
    wait_until(lambda: not daemon.alive, "the end of the daemon")
    assert name in state.remove_stale()
    assert traces(name) == []
    assert host.ssh("true").returncode == 0  # another host is not affected


@pytest.mark.host
def test_next_start_removes_what_a_killed_daemon_left(boot_host: Callable[..., Host], tmp_path: Path) -> None:
    name = f"daemon-{tmp_path.parent.name}"
    first = boot_host(name=name)
    daemon = state.read(first.folder)
    assert daemon is not None
    os.kill(daemon.pid, 9)
    assert first._process is not None
    first._process.wait(60)
    wait_until(lambda: not [trace for trace in traces(name) if "nspawn" in trace], "the end of the robot")
    second = boot_host(name=name)
    assert second.ssh("true").returncode == 0
    second.end()
    assert traces(name) == []


@pytest.mark.host
def test_host_changes_nothing_on_this_machine(boot_host: Callable[..., Host]) -> None:
    def snapshot() -> list[str]:
        links = subprocess.run(["ip", "-o", "link"], capture_output=True, text=True, check=True).stdout
        mounts = [line for line in Path("/proc/self/mountinfo").read_text().splitlines() if "lupin-host" in line]
        return [links, *mounts, *map(str, Path("/run/netns").glob("*")), Path("/proc/sys/net/ipv4/ip_forward").read_text()]

    before = snapshot()
    booted = boot_host()
    assert snapshot() == before
    assert booted.ssh("sudo sysctl -q -w net.ipv4.ip_forward=1; cat /proc/sys/net/ipv4/ip_forward").stdout == "1\n"
    assert snapshot() == before
    booted.end()
    assert snapshot() == before


@pytest.mark.host
def test_commands_boot_a_host_inject_a_fault_and_end_the_host(tmp_path: Path) -> None:
    def lupin(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [*LUPIN, "sim", "host", *arguments]
        return subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, timeout=120, check=False)

    if missing := prerequisites.missing_prerequisite():
        pytest.skip(missing)
    name_option = ("--name", f"cli-{tmp_path.parent.name}")
    try:
        assert "mirte is up" in lupin("up", *name_option).stdout
        assert lupin("up", *name_option).returncode == 1
        refused = lupin("ssh", *name_option, "--", "sh", "-c", "'hostname; exit 3'")
        assert (refused.returncode, refused.stdout) == (3, "mirte\n")
        assert "lan0" in lupin("laptop", *name_option, "--", "ip", "link").stdout
        assert lupin("fault", "cable-cut", "link=wlan0", *name_option).stdout == "cable-cut: done\n"
        assert "faults: cable-cut" in lupin("status", *name_option).stdout
        assert lupin("fault", "cable-cut", "--undo", *name_option).returncode == 0
        assert lupin("fault", "nosuch", *name_option).returncode == 2
        assert lupin("fault", "slow-link", "delay_ms=soon", *name_option).returncode == 2
    finally:
        down = lupin("down", *name_option)
    assert down.returncode == 0, down.stderr
    assert traces(name_option[1]) == []
    assert lupin("ssh", *name_option).returncode == 1


def test_fault_command_lists_faults_without_a_host() -> None:
    done = subprocess.run([*LUPIN, "sim", "host", "fault"], cwd=PROJECT, capture_output=True, text=True, timeout=60, check=True)
    assert "server-not-started" in done.stdout
    assert "cause=port" in done.stdout


def test_missing_programs_are_named_with_their_packages(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(prerequisites, "SEARCH_PATH", str(tmp_path))
    message = prerequisites.missing_prerequisite()
    assert message is not None
    assert "systemd-nspawn" in message
    assert "apt-get install" in message
    assert "systemd-container" in message


def test_start_without_root_says_that_it_needs_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with pytest.raises(HostUnavailable, match="needs root here"):
        Host.start()


class Cache:
    """An empty cache of root file systems, with a stand-in builder that counts its calls."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        self.folder, self.builds = tmp_path / "lupin-host", 0
        self.packed = self.folder / f"root-{rootfs.recipe_hash()}.tar.zst"
        monkeypatch.setattr(rootfs, "_build", self._build)

    def _build(self, root: Path, _: rootfs.Progress) -> None:
        self.builds += 1
        (root / "etc").mkdir(parents=True)
        (root / "etc/made").write_text(str(self.builds))


@pytest.fixture
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Cache:
    if shutil.which("zstd") is None:
        pytest.skip("this machine lacks zstd: apt-get install zstd")
    return Cache(monkeypatch, tmp_path)


def test_root_is_built_once(cache: Cache) -> None:
    first = rootfs.root_directory()
    assert (first / "etc/made").read_text() == "1"
    assert rootfs.root_directory() == first
    assert cache.builds == 1


def test_packed_root_is_unpacked_instead_of_built(cache: Cache) -> None:
    shutil.rmtree(rootfs.root_directory())
    assert (rootfs.root_directory() / "etc/made").read_text() == "1"
    assert cache.builds == 1


def test_partly_built_root_is_removed_and_not_used(cache: Cache) -> None:
    stale = cache.folder / ".building-1"
    (stale / "root").mkdir(parents=True)
    assert rootfs.cached_root() is None
    assert (rootfs.root_directory() / "etc/made").read_text() == "1"
    assert not stale.exists()


def test_truncated_packed_root_is_rebuilt(cache: Cache) -> None:
    root = rootfs.root_directory()
    complete = cache.packed.read_bytes()
    for size in (0, 1, len(complete) // 2, len(complete) - 1):
        shutil.rmtree(root)
        cache.packed.write_bytes(complete[:size])
        progress: list[str] = []
        builds = cache.builds
        assert (rootfs.root_directory(progress.append) / "etc/made").read_text() == str(builds + 1)
        assert any("damaged" in line for line in progress)


def test_failed_build_leaves_no_root(cache: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(root: Path, _: rootfs.Progress) -> None:
        root.mkdir()
        raise rootfs.RootError("no mirror")

    monkeypatch.setattr(rootfs, "_build", fail)
    with pytest.raises(rootfs.RootError, match="no mirror"):
        rootfs.root_directory()
    assert sorted(path.name for path in cache.folder.iterdir()) == ["lock"]
