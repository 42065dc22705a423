"""The lock file is complete: whatever a locked package requires is locked, in a version that satisfies it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from importlib.metadata import requires, version
from pathlib import Path

import pytest
import tomllib
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
LOCK = ROOT / "requirements.lock"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
OWN = {"lupin", "lupin-interfaces"}  # built from this checkout
PEERS = ["bench/peers/requirements.lock", "bench/peers/rosbridge_suite.lock", "tests/support/roslibpy.lock"]
PYTHONS = ["3.11", "3.12", "3.13"]


def read_lock(text: str) -> dict[str, str]:
    """Return the version of each locked package. Raises ValueError for a line that pins nothing, or without a hash."""
    found: dict[str, str] = {}
    for entry in re.split(r"\n(?=\S)", text.strip()):
        match = re.fullmatch(r"([\w.-]+)==(\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)", entry)
        if match is None:
            raise ValueError(f"not a name, a version and its hashes: {entry!r}")
        found[canonicalize_name(match[1])] = match[2]
    return found


def unmet(locked: dict[str, str], roots: Iterable[str], python: str) -> Iterator[str]:
    """Yield what is required, directly or not, with extras as they are asked for, and not locked in a version that fits.

    The requirements of each package are those that its installed version declares.
    """
    machine = {name: str(value) for name, value in default_environment().items()}
    environment = {**machine, "python_version": python, "python_full_version": f"{python}.0"}
    waiting = [("pyproject.toml", "", root) for root in roots]
    done: set[tuple[str, str]] = set()
    while waiting:
        owner, extra, text = waiting.pop()
        requirement = Requirement(text)
        name = canonicalize_name(requirement.name)
        if requirement.marker is not None and not requirement.marker.evaluate({**environment, "extra": extra}):
            continue
        if name not in OWN:
            if name not in locked:
                yield f"{owner} requires {text}, which is not locked"
                continue
            if not requirement.specifier.contains(locked[name], prereleases=True):
                yield f"{owner} requires {text}, and {locked[name]} is locked"
        for wanted in {"", *requirement.extras}:
            if (name, wanted) not in done:
                done.add((name, wanted))
                waiting += [(f"{name}[{wanted}]" if wanted else name, wanted, each) for each in requires(name) or ()]


def test_environment_is_what_is_locked() -> None:
    locked = read_lock(LOCK.read_text())
    assert {name: version(name) for name in locked} == locked


@pytest.mark.parametrize("python", PYTHONS)
def test_every_requirement_is_locked(python: str) -> None:
    roots = ["lupin[dev]", *PROJECT["dependencies"], *PROJECT["optional-dependencies"]["dev"]]
    assert list(unmet(read_lock(LOCK.read_text()), roots, python)) == []


def test_requirement_of_an_extra_that_is_not_locked_is_found() -> None:
    locked = {name: locked for name, locked in read_lock(LOCK.read_text()).items() if name != "ros-rmw-fastrtps-cpp"}
    assert [line for line in unmet(locked, ["ros-jazzy-rclpy"], PYTHONS[0]) if "rclpy" in line] == []
    assert any("which is not locked" in line for line in unmet(locked, ["ros-jazzy-rclpy[fastrtps]"], PYTHONS[0]))


def test_requirement_whose_locked_version_is_too_old_is_found() -> None:
    locked = {**read_lock(LOCK.read_text()), "coverage": "7.0"}
    found = list(unmet(locked, ["pytest-cov"], PYTHONS[0]))
    assert found == ["pytest-cov requires coverage[toml]>=7.10.6, and 7.0 is locked"]


@pytest.mark.parametrize("text", ["coverage[toml]==7.17.3 \\\n    --hash=sha256:" + "0" * 64, "numpy>=2", "numpy==2.0"])
def test_line_without_version_or_hash_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="not a name, a version and its hashes"):
        read_lock(text)


@pytest.mark.parametrize(
    "lock", ["bench/peers/requirements.lock", "bench/peers/rosbridge_suite.lock", "tests/support/roslibpy.lock"]
)
def test_peers_are_locked_with_hashes(lock: str) -> None:
    source = (ROOT / lock).with_suffix(".txt").read_text()
    pinned = dict(line.split("==") for line in source.splitlines() if line and not line.startswith("#"))
    assert pinned.items() <= read_lock((ROOT / lock).read_text()).items()
