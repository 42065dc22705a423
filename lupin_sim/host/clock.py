"""The simulated computer's wall clock: a memory page that this module shares with every program on the computer (clock.c)."""

from __future__ import annotations

import hashlib
import mmap
import secrets
import struct
import subprocess
import time
from dataclasses import astuple, dataclass, replace
from pathlib import Path

from lupin_sim.host.rootfs import RootError, cache_directory

PAGE = struct.Struct("<IIqqqqqqqqqq")  # must match `struct page` in clock.c
MAGIC = 0x4B434F4C
STA_UNSYNC = 64
SOURCE = Path(__file__).with_name("clock.c")


@dataclass(frozen=True)
class _Page:
    """The fields of the page; see clock.c."""

    sequence: int
    magic: int
    wall_ns: int
    machine_ns: int
    crystal_ppb: int
    frequency: int
    tick_us: int
    status: int
    maxerror_us: int
    esterror_us: int
    constant: int
    steps: int

    def wall_at(self, machine_ns: int) -> int:
        """Return what the clock shows when this machine's clock shows `machine_ns`, ns."""
        rate_ppb = self.crystal_ppb + self.frequency * 1000 // 65536 + (self.tick_us - 10000) * 100000
        elapsed = machine_ns - self.machine_ns
        return self.wall_ns + elapsed + elapsed * rate_ppb // 10**9


class Clock:
    """The clock in a new page at `path`: correct, with a perfect crystal."""

    def __init__(self, path: Path) -> None:
        path.write_bytes(bytes(mmap.PAGESIZE))
        path.chmod(0o644)  # who can write the page can set the clock, so only root may
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), mmap.PAGESIZE)
        self.reset()

    def reset(self) -> None:
        """Set the state of a new robot's clock: correct, with a perfect crystal, not disciplined by any program."""
        now = time.time_ns()
        self._write(_Page(0, MAGIC, now, now, 0, 0, 10000, STA_UNSYNC, 16_000_000, 16_000_000, 7, 0))

    @property
    def offset_s(self) -> float:
        """How far the clock is ahead of this machine's."""
        page, now = self._read(), time.time_ns()
        return (page.wall_at(now) - now) / 1e9

    @property
    def crystal_ppm(self) -> float:
        """How much too fast the crystal runs."""
        return self._read().crystal_ppb / 1e3

    @property
    def steps(self) -> int:
        """How often a program on the robot set or stepped the clock."""
        return self._read().steps

    def disturb(self, offset_s: float | None = None, crystal_ppm: float | None = None) -> None:
        """Change the clock's offset to this machine's clock, or its crystal, without counting a step."""
        page, now = self._read(), time.time_ns()
        wall_ns = page.wall_at(now) if offset_s is None else now + round(offset_s * 1e9)
        crystal_ppb = page.crystal_ppb if crystal_ppm is None else round(crystal_ppm * 1e3)
        self._write(replace(page, sequence=page.sequence + 2, wall_ns=wall_ns, machine_ns=now, crystal_ppb=crystal_ppb))

    def _read(self) -> _Page:
        while True:
            before = _Page(*PAGE.unpack_from(self._map))
            if before.sequence % 2 == 0 and before == _Page(*PAGE.unpack_from(self._map)):
                return before

    def _write(self, page: _Page) -> None:
        PAGE.pack_into(self._map, 0, *astuple(page))


def clock_library() -> Path:
    """Return the path of the compiled clock.c; compile it if the cache does not have it. Raises RootError."""
    name = hashlib.sha256(SOURCE.read_bytes()).hexdigest()[:16]
    built = cache_directory() / f"clock-{name}.so"
    if not built.exists():
        built.parent.mkdir(parents=True, exist_ok=True)
        draft = built.with_suffix(f".{secrets.token_hex(4)}")  # random: every daemon has PID 1 in its own namespace
        command = ["gcc", "-O2", "-Wall", "-shared", "-fPIC", "-o", str(draft), str(SOURCE)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        if done.returncode:
            raise RootError(f"the simulated computer's clock does not compile: {done.stderr.strip()[-500:]}")
        draft.rename(built)
    return built
