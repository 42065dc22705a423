"""A simulated computer with the vendor's stack, and `lupin` as an operator types it on the laptop."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner, Result

from lupin_cli.release.signing_key import ensure_key, key_path

if TYPE_CHECKING:
    from lupin_sim.host import Host


@pytest.fixture(scope="module")
def robot_host() -> Iterator[Host]:
    """Boot a robot with the vendor's stack, which the tests of a file share."""
    from lupin_sim.host.fixtures import boot_or_skip

    with boot_or_skip(vendor_robot=True) as host:
        yield host


@pytest.fixture(scope="module")
def release_key(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the release key of the operator, who has another home directory in each test of a file."""
    folder = tmp_path_factory.mktemp("operator")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(folder))
        ensure_key()
        return key_path()


@pytest.fixture
def lupin(robot_host: Host, release_key: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """`lupin("deploy", "robot")` runs the command in this process, on the laptop's network, with its own home directory."""
    from lupin_cli.app import app

    state = tmp_path / ".local/state/lupin"
    state.mkdir(mode=0o700, parents=True)
    shutil.copy(release_key, state)
    (tmp_path / ".ssh").mkdir(mode=0o700)
    (tmp_path / ".ssh/known_hosts").write_bytes(robot_host.known_hosts.read_bytes())
    inventory = tmp_path / "lupin.toml"
    inventory.write_text('[robots.mirte]\nuser = "mirte"\nros_setup = ["source ~/mirte_ws/install/setup.bash"]\n')
    with inventory.open("a") as file:
        file.write('[robots.mirte.addresses]\nwired = "10.42.0.1"\n')
    (tmp_path / ".ssh/config").write_text(f"Host *\n  IdentityFile {robot_host.key}\n")
    for name in [name for name in os.environ if name.startswith(("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_", "XDG_"))]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("LUPIN_CONFIG", str(inventory))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def run(*words: str) -> Result:
        with robot_host.on_laptop():
            return CliRunner().invoke(app, list(words))

    return run
