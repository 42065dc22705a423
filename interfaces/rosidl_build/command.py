"""The setuptools command ``build_ext``: builds importable packages from interface definitions."""

import fcntl
import os
import shutil
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from setuptools.command.build_ext import build_ext

from . import generators, native
from .freshness import build_keys
from .packages import InterfacePackage, discover
from .toolchain import find_toolchain

INTERFACES = Path(__file__).resolve().parents[1]
ModuleFileName = Callable[[InterfacePackage], str]
EDITABLE_FOLDER = "build/editable"
"""The folder of generated packages in an editable install, and of the egg-info in every install; git ignores it."""


class BuildInterfaces(build_ext):
    """Generates and compiles the interface packages instead of listed extension sources."""

    def run(self) -> None:
        """Build every package into ``build_lib``, or into EDITABLE_FOLDER for an editable install."""
        target_root = INTERFACES / EDITABLE_FOLDER if self.inplace else Path(self.build_lib).resolve()
        # not build_temp, which is a new folder in each editable build
        work_dir = INTERFACES / "build" / f"rosidl-{sysconfig.get_config_var('SOABI')}"
        with _exclusive(work_dir):
            for leftover in target_root.glob("*/__init__.py"):  # else files of removed definitions would be installed
                shutil.rmtree(leftover.parent)
            build(discover(INTERFACES), work_dir, target_root, self._module_file_name)

    def _module_file_name(self, package: InterfacePackage) -> str:
        return Path(self.get_ext_filename(package.extension_module)).name


def build(packages: list[InterfacePackage], work_dir: Path, target_root: Path, module_file_name: ModuleFileName) -> None:
    """Build ``packages``, sorted by dependency, as importable folders in ``target_root``.

    ``work_dir`` keeps all intermediate files, so that a later call builds only changed packages.
    """
    started = time.monotonic()
    toolchain = find_toolchain()
    keys = build_keys(packages, toolchain)
    built = {p.name: work_dir / "built" / p.name for p in packages}
    stamps = {p.name: work_dir / "built" / f"{p.name}.key" for p in packages}
    stale = [p for p in packages if not stamps[p.name].exists() or stamps[p.name].read_text() != keys[p.name]]
    for package in stale:
        stamps[package.name].unlink(missing_ok=True)
        for leftover in work_dir.glob(f"*/{package.name}"):
            shutil.rmtree(leftover)

    descriptions = generators.known_type_descriptions(toolchain.ros_prefix)
    descriptions |= {p.name: generators.description_dir(work_dir, p) for p in packages}
    described = [generators.describe(p, work_dir, descriptions) for p in stale]
    _report(
        started, f"described {sum(len(p.definitions) for p in stale)} interfaces in {len(stale)} of {len(packages)} packages"
    )

    jobs = [(d, name, toolchain.ros_prefix) for d in described for name in generators.GENERATORS]
    jobs.sort(key=lambda job: -len(job[0].package.definitions))
    with get_context("fork").Pool(native.cpu_count()) as pool:
        pool.starmap(generators.generate, jobs, chunksize=1)
    _report(started, "generated their sources")

    include_dirs = [work_dir / name for name in generators.GENERATORS]
    units = {d.package.name: native.write_units(d, work_dir / "objects" / d.package.name) for d in described}
    native.compile_units([u for us in units.values() for u in us], include_dirs, toolchain)
    _report(started, f"compiled {sum(map(len, units.values()))} translation units")

    modules = {p.name: built[p.name] / module_file_name(p) for p in packages}
    for d in described:
        package = d.package
        shutil.copytree(d.sources_dir("python"), built[package.name], ignore=shutil.ignore_patterns("*.c", "*.h"))
        siblings = {name: module for name, module in modules.items() if name in package.depends}
        native.link(modules[package.name], [u.object for u in units[package.name]], siblings, toolchain)
        stamps[package.name].write_text(keys[package.name])
    for package in packages:
        shutil.copytree(built[package.name], target_root / package.name)
    _report(started, f"put {', '.join(built)} into {os.path.relpath(target_root)}")


@contextmanager
def _exclusive(work_dir: Path) -> Iterator[None]:
    """Lock ``work_dir``: waits for other builds of this source tree, which developers may share."""
    work_dir.mkdir(parents=True, exist_ok=True)
    # For this user only: whoever can open the file can hold its lock.
    with os.fdopen(os.open(work_dir / "lock", os.O_WRONLY | os.O_CREAT, 0o600), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _report(started: float, what: str) -> None:
    print(f"rosidl_build: {time.monotonic() - started:5.1f} s  {what}", flush=True)
