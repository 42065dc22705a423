"""The robot's wall clock, seen from outside: one page shared with every program in there (clock.c)."""

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

PAGE = struct.Struct("<IIqqqqqqqqqq")  # kept in step with `struct page` in clock.c
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
        """What the clock shows at an instant of the machine's clock, ns."""
        rate_ppb = self.crystal_ppb + self.frequency * 1000 // 65536 + (self.tick_us - 10000) * 100000
        passed = machine_ns - self.machine_ns
        return self.wall_ns + passed + passed * rate_ppb // 10**9


class Clock:
    """A page at `path`, made anew: right, and with a perfect crystal."""

    def __init__(self, path: Path) -> None:
        path.write_bytes(bytes(mmap.PAGESIZE))
        path.chmod(0o644)  # who may write the page may set the clock: root
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), mmap.PAGESIZE)
        self.reset()

    def reset(self) -> None:
        """As it is on a new robot: right, a perfect crystal, disciplined by nobody."""
        now = time.time_ns()
        self._write(_Page(0, MAGIC, now, now, 0, 0, 10000, STA_UNSYNC, 16_000_000, 16_000_000, 7, 0))

    @property
    def offset_s(self) -> float:
        """How far it is ahead of this machine's clock."""
        page, now = self._read(), time.time_ns()
        return (page.wall_at(now) - now) / 1e9

    @property
    def crystal_ppm(self) -> float:
        """How much too fast its crystal runs."""
        return self._read().crystal_ppb / 1e3

    @property
    def steps(self) -> int:
        """How often a program in the robot set it or made it jump."""
        return self._read().steps

    def make_wrong(self, offset_s: float | None = None, crystal_ppm: float | None = None) -> None:
        """Put it ahead of this machine's clock, or give it another crystal, without a program in the robot noticing."""
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


def library() -> Path:
    """The compiled clock.c, from the cache where it is there. Raises RootError."""
    name = hashlib.sha256(SOURCE.read_bytes()).hexdigest()[:16]
    built = cache_directory() / f"clock-{name}.so"
    if not built.exists():
        built.parent.mkdir(parents=True, exist_ok=True)
        draft = built.with_suffix(f".{secrets.token_hex(4)}")  # by chance: every keeper is process 1 of its own
        command = ["gcc", "-O2", "-Wall", "-shared", "-fPIC", "-o", str(draft), str(SOURCE)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        if done.returncode:
            raise RootError(f"the robot's clock does not compile: {done.stderr.strip()[-500:]}")
        draft.rename(built)
    return built
