"""A host leaves nothing behind, however it ends, and touches nothing of this machine; what is missing is said plainly."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_sim.host import Host, HostUnavailable, missing, rootfs, state
from lupin_sim.host.fixtures import until
from lupin_sim.host.host import PROJECT
from lupin_sim.host.missing import cgroup_roots

LUPIN = [sys.executable, "-m", "lupin_cli.app"]


def traces(name: str) -> list[str]:
    """Whatever on this machine still bears a host's name."""
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
host.robot.fault("slow-link")
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.host
def test_nothing_is_left_when_the_process_that_booted_it_is_killed(host: Host, tmp_path: Path) -> None:
    name = f"killed-{tmp_path.parent.name}"
    killed = subprocess.run([sys.executable, "-c", KILLED.format(name=name)], cwd=PROJECT, timeout=90, check=False)
    assert killed.returncode == -9
    keeping = state.read(state.STATE / name)
    assert keeping is not None
    until(lambda: not keeping.alive, "the end of the keeper")
    assert name in state.sweep()
    assert traces(name) == []
    assert host.ssh("true").returncode == 0  # a neighbour's host was let be


@pytest.mark.host
def test_what_a_killed_keeper_leaves_is_swept_at_the_next_start(boot_host: Callable[..., Host], tmp_path: Path) -> None:
    name = f"keeper-{tmp_path.parent.name}"
    first = boot_host(name=name)
    keeping = state.read(first.folder)
    assert keeping is not None
    os.kill(keeping.pid, 9)
    assert first._process is not None
    first._process.wait(10)
    until(lambda: not [trace for trace in traces(name) if "nspawn" in trace], "the end of the robot")
    second = boot_host(name=name)
    assert second.ssh("true").returncode == 0
    second.end()
    assert traces(name) == []


@pytest.mark.host
def test_a_host_touches_nothing_of_this_machine(boot_host: Callable[..., Host]) -> None:
    def machine() -> list[str]:
        links = subprocess.run(["ip", "-o", "link"], capture_output=True, text=True, check=True).stdout
        mounts = [line for line in Path("/proc/self/mountinfo").read_text().splitlines() if "lupin-host" in line]
        return [links, *mounts, *map(str, Path("/run/netns").glob("*")), Path("/proc/sys/net/ipv4/ip_forward").read_text()]

    before = machine()
    booted = boot_host()
    assert machine() == before
    assert booted.ssh("sudo sysctl -q -w net.ipv4.ip_forward=1; cat /proc/sys/net/ipv4/ip_forward").stdout == "1\n"
    assert machine() == before
    booted.end()
    assert machine() == before


@pytest.mark.host
def test_the_command_line_boots_breaks_and_takes_down(tmp_path: Path) -> None:
    def lupin(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [*LUPIN, "sim", "host", *arguments]
        return subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, timeout=120, check=False)

    if why := missing.what_is_missing():
        pytest.skip(why)
    named = ("--name", f"cli-{tmp_path.parent.name}")
    try:
        assert "mirte is up" in lupin("up", *named).stdout
        assert lupin("up", *named).returncode == 1
        refused = lupin("ssh", *named, "--", "sh", "-c", "'hostname; exit 3'")
        assert (refused.returncode, refused.stdout) == (3, "mirte\n")
        assert "lan0" in lupin("laptop", *named, "--", "ip", "link").stdout
        assert lupin("fault", "cable-cut", "link=wlan0", *named).stdout == "cable-cut: done\n"
        assert "faults: cable-cut" in lupin("status", *named).stdout
        assert lupin("fault", "cable-cut", "--undo", *named).returncode == 0
        assert lupin("fault", "nosuch", *named).returncode == 2
        assert lupin("fault", "slow-link", "delay_ms=soon", *named).returncode == 2
    finally:
        down = lupin("down", *named)
    assert down.returncode == 0, down.stderr
    assert traces(named[1]) == []
    assert lupin("ssh", *named).returncode == 1


def test_every_fault_is_listed_without_a_host() -> None:
    done = subprocess.run([*LUPIN, "sim", "host", "fault"], cwd=PROJECT, capture_output=True, text=True, timeout=60, check=True)
    assert "server-not-started" in done.stdout
    assert "cause=port" in done.stdout


def test_missing_programs_are_named_with_their_packages(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(missing, "SEARCHED", str(tmp_path))
    said = missing.what_is_missing()
    assert said is not None
    assert "systemd-nspawn" in said
    assert "apt-get install" in said
    assert "systemd-container" in said


def test_without_root_the_host_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with pytest.raises(HostUnavailable, match="needs root here"):
        Host.start()


class Cache:
    """An empty cache, and a builder that counts."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        self.folder, self.built = tmp_path / "lupin-host", 0
        self.packed = self.folder / f"root-{rootfs.key()}.tar.zst"
        monkeypatch.setattr(rootfs, "_build", self._build)

    def _build(self, root: Path, _: rootfs.Progress) -> None:
        self.built += 1
        (root / "etc").mkdir(parents=True)
        (root / "etc/made").write_text(str(self.built))


@pytest.fixture
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Cache:
    if shutil.which("zstd") is None:
        pytest.skip("this machine lacks zstd: apt-get install zstd")
    return Cache(monkeypatch, tmp_path)


def test_a_root_is_built_once_and_then_found(cache: Cache) -> None:
    first = rootfs.root_directory()
    assert (first / "etc/made").read_text() == "1"
    assert rootfs.root_directory() == first
    assert cache.built == 1


def test_a_packed_root_is_unpacked_instead_of_built(cache: Cache) -> None:
    shutil.rmtree(rootfs.root_directory())
    assert (rootfs.root_directory() / "etc/made").read_text() == "1"
    assert cache.built == 1


def test_a_half_built_root_is_never_used(cache: Cache) -> None:
    left = cache.folder / ".building-1"
    (left / "root").mkdir(parents=True)
    assert rootfs.cached_root() is None
    assert (rootfs.root_directory() / "etc/made").read_text() == "1"
    assert not left.exists()


def test_a_packed_root_cut_at_any_place_is_built_anew(cache: Cache) -> None:
    root = rootfs.root_directory()
    whole = cache.packed.read_bytes()
    for size in (0, 1, len(whole) // 2, len(whole) - 1):
        shutil.rmtree(root)
        cache.packed.write_bytes(whole[:size])
        said: list[str] = []
        built = cache.built
        assert (rootfs.root_directory(said.append) / "etc/made").read_text() == str(built + 1)
        assert any("damaged" in line for line in said)


def test_a_builder_that_fails_leaves_no_root(cache: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(root: Path, _: rootfs.Progress) -> None:
        root.mkdir()
        raise rootfs.RootError("no mirror")

    monkeypatch.setattr(rootfs, "_build", fail)
    with pytest.raises(rootfs.RootError, match="no mirror"):
        rootfs.root_directory()
    assert sorted(path.name for path in cache.folder.iterdir()) == ["lock"]
