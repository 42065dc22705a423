"""The lock of the cache of root file systems."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

import pytest

from lupin_sim.host import rootfs


def test_only_the_owner_can_hold_the_lock(tmp_path: Path) -> None:
    (tmp_path / "lock").touch(mode=0o666)
    with rootfs._locked(tmp_path, lambda _: None):
        assert (tmp_path / "lock").stat().st_mode & 0o777 == 0o600
        other = os.open(tmp_path / "lock", os.O_RDWR)
        with pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.close(other)


def test_held_lock_ends_the_wait_with_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rootfs, "BUILD_TIMEOUT_S", 0.3)
    said: list[str] = []
    with (
        rootfs._locked(tmp_path, said.append),
        pytest.raises(rootfs.RootError, match=r"fuser .*lock"),
        rootfs._locked(tmp_path, said.append),
    ):
        pass
    assert said == ["another process builds the root: waiting for it"]


def test_lock_that_is_a_link_is_refused(tmp_path: Path) -> None:
    (tmp_path / "lock").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="symbolic"), rootfs._locked(tmp_path, lambda _: None):
        pass
    assert not (tmp_path / "elsewhere").exists()
