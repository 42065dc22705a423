"""The setuptools command: everything from definitions to importable packages, inside ``build_ext``."""

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
"""Where an editable install keeps the generated packages (and every install its egg-info), out of git."""


class BuildInterfaces(build_ext):
    """Generates and compiles the interface packages in place of compiling listed sources."""

    def run(self) -> None:
        """Build every package into ``build_lib``, or into EDITABLE_FOLDER for an editable install."""
        target_root = INTERFACES / EDITABLE_FOLDER if self.inplace else Path(self.build_lib).resolve()
        # not build_temp, which is a new folder for each editable build
        work_dir = INTERFACES / "build" / f"rosidl-{sysconfig.get_config_var('SOABI')}"
        with _only_one_in(work_dir):
            for leftover in target_root.glob("*/__init__.py"):  # what a removed definition left would be shipped
                shutil.rmtree(leftover.parent)
            build(discover(INTERFACES), work_dir, target_root, self._module_file_name)

    def _module_file_name(self, package: InterfacePackage) -> str:
        return Path(self.get_ext_filename(package.extension_module)).name


def build(packages: list[InterfacePackage], work_dir: Path, target_root: Path, module_file_name: ModuleFileName) -> None:
    """Build ``packages`` (each after those it depends on) as importable folders in ``target_root``.

    ``work_dir`` keeps everything on the way, so that a later call builds only what has changed.
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
def _only_one_in(work_dir: Path) -> Iterator[None]:
    """Wait for other builds of this source tree; two developers may share it."""
    work_dir.mkdir(parents=True, exist_ok=True)
    with (work_dir / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _report(started: float, what: str) -> None:
    print(f"rosidl_build: {time.monotonic() - started:5.1f} s  {what}", flush=True)
