"""The robot has Python 3.10: the interfaces build with it, and work together with this Python.

The environment is built once for each version of ``interfaces/``, and kept in the user's cache.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
INTERFACES = REPOSITORY / "interfaces"
PACKAGES = ("lupin_msgs", "mirte_msgs", "tf2_msgs")
"""Some packages with messages, services and actions; they build in a third of the time of all packages."""
BUILD_TIMEOUT_S = 900
KEPT_ENVIRONMENTS = 2
# The first test builds the environment, which may take minutes on a busy machine.
pytestmark = [pytest.mark.timeout(BUILD_TIMEOUT_S), pytest.mark.long]


def clean_environment() -> dict[str, str]:
    """Return this process's environment without variables that would make another Python load this one's libraries."""
    unwanted = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")
    return {name: value for name, value in os.environ.items() if name not in unwanted}


def find_python310() -> Path | None:
    """Return a CPython 3.10 with headers from PATH or pyenv, or None. It is started, since a pyenv shim may not work."""
    on_path = shutil.which("python3.10")
    candidates = [Path(on_path)] if on_path else []
    candidates += sorted((Path.home() / ".pyenv" / "versions").glob("3.10*/bin/python"))
    check = "import sys, sysconfig, pathlib; sys.exit(not (pathlib.Path(sysconfig.get_path('include')) / 'Python.h').exists())"
    for python in candidates:
        if subprocess.run([python, "-c", check], capture_output=True, env=clean_environment()).returncode == 0:
            return python
    return None


def sources() -> list[Path]:
    """Return all files that the build of these packages reads."""
    folders = [INTERFACES / name for name in ("rosidl_build", *PACKAGES)]
    files = [p for folder in folders for p in folder.rglob("*") if p.is_file() and p.suffix != ".pyc"]
    return sorted(files + [p for p in INTERFACES.iterdir() if p.suffix in (".toml", ".md")])


def cache_root() -> Path:
    """Return the folder of the environments."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "lupin"


def build_environment(python: Path, folder: Path) -> None:
    """Create a virtual environment, and install lupin-interfaces like a user: ``pip install <folder>``."""
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run([python, "-m", "venv", folder], check=True, env=clean_environment())
    copy = folder / "interfaces"
    for source in sources():
        target = copy / source.relative_to(INTERFACES)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
    install: list[str | Path] = [folder / "bin" / "python", "-m", "pip", "install", "--disable-pip-version-check", copy]
    # Without optimization it compiles faster, and the tests run only for a second.
    env = {**clean_environment(), "LUPIN_INTERFACES_OPTIMISATION": "-O0"}
    result = subprocess.run(
        install,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=BUILD_TIMEOUT_S,
    )
    assert result.returncode == 0, result.stdout[-8000:]
    shutil.rmtree(copy)


@pytest.fixture(scope="module")
def python310() -> Path:
    """Return a Python 3.10 with the current interfaces installed."""
    python = find_python310()
    if python is None:
        missing = "no CPython 3.10 with headers on PATH or in ~/.pyenv/versions: pyenv install 3.10"
        if os.environ.get("LUPIN_CI_STRICT") == "1":
            pytest.fail(missing)
        pytest.skip(missing)
    digest = hashlib.sha256(str(python).encode())
    for path in sources():
        digest.update(str(path.relative_to(INTERFACES)).encode() + b"\0" + path.read_bytes() + b"\0")
    cache_root().mkdir(parents=True, exist_ok=True)
    environment = cache_root() / f"py310-{digest.hexdigest()[:12]}"
    complete = environment / "complete"
    with (cache_root() / "py310.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not complete.exists():
            build_environment(python, environment)
            complete.touch()
            by_age = sorted(cache_root().glob("py310-*"), key=lambda p: p.stat().st_mtime, reverse=True)
            for old in by_age[KEPT_ENVIRONMENTS:]:
                shutil.rmtree(old)
    return environment / "bin" / "python"


def test_packages_import_with_their_type_support(python310: Path) -> None:
    script = """
import importlib, sys
assert sys.version_info[:2] == (3, 10), sys.version
for package in sys.argv[1:]:
    for kind in ("msg", "srv", "action"):
        try:
            module = importlib.import_module(f"{package}.{kind}")
        except ModuleNotFoundError as error:
            assert error.name == f"{package}.{kind}", error
            continue
        for name, interface in vars(module).items():
            if name[0].isupper():
                type(interface).__import_type_support__()
                assert type(interface)._TYPE_SUPPORT is not None, (package, name)
print("imported", len(sys.argv) - 1)
"""
    command = [python310, "-c", script, *PACKAGES]
    result = subprocess.run(command, capture_output=True, text=True, env=clean_environment(), timeout=60)  # type: ignore[arg-type]
    assert (result.returncode, result.stdout) == (0, f"imported {len(PACKAGES)}\n"), result.stderr


@pytest.mark.graph
@pytest.mark.skipif(sys.version_info[:2] == (3, 10), reason="this Python is 3.10; test_graph.py covers it")
def test_service_works_between_both_pythons(python310: Path, node_and_executor: Any, start_peer: Any) -> None:
    from lupin_msgs.srv import GetField

    node, executor = node_and_executor
    start_peer("serve", python=python310, env=clean_environment())
    client = node.create_client(GetField, "get_field")
    assert client.wait_for_service(20.0)
    future = client.call_async(GetField.Request(sensor_type="co2", bbox_min_x=-1.5))
    executor.spin_until_future_complete(future, timeout_sec=20.0)
    assert future.done()
    assert future.result().error_message == "co2"
    assert future.result().values[0] == -1.5
