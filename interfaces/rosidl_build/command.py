"""The setuptools command: everything from definitions to importable packages, inside ``build_ext``."""

import os
import shutil
import time
from multiprocessing import get_context
from pathlib import Path

from setuptools.command.build_ext import build_ext

from . import generators, native
from .packages import InterfacePackage, discover
from .toolchain import find_toolchain

INTERFACES = Path(__file__).resolve().parents[1]
EDITABLE_FOLDER = "build/editable"
"""Where an editable install keeps the generated packages (and every install its egg-info), out of git."""


class BuildInterfaces(build_ext):
    """Generates and compiles the interface packages in place of compiling listed sources."""

    def run(self) -> None:
        """Build every package into ``build_lib``, or into EDITABLE_FOLDER for an editable install."""
        target_root = INTERFACES / EDITABLE_FOLDER if self.inplace else Path(self.build_lib).resolve()
        for leftover in target_root.glob("*/__init__.py"):  # what a removed definition left would be shipped
            shutil.rmtree(leftover.parent)
        build(discover(INTERFACES), Path(self.build_temp).resolve() / "rosidl", target_root, self._module_file_name)

    def _module_file_name(self, package: InterfacePackage) -> str:
        return Path(self.get_ext_filename(package.extension_module)).name


def build(packages: list[InterfacePackage], work_dir: Path, target_root: Path, module_file_name) -> None:
    """Build ``packages`` (each after those it depends on) as importable folders in ``target_root``."""
    started = time.monotonic()
    toolchain = find_toolchain()
    shutil.rmtree(work_dir, ignore_errors=True)
    object_dir = work_dir / "objects"
    object_dir.mkdir(parents=True)

    descriptions = generators.known_type_descriptions(toolchain.ros_prefix)
    described = [generators.describe(p, work_dir, toolchain.ros_prefix, descriptions) for p in packages]
    _report(started, f"described {sum(len(p.definitions) for p in packages)} interfaces in {len(packages)} packages")

    jobs = [(d, name, toolchain.ros_prefix) for d in described for name in generators.GENERATORS]
    jobs.sort(key=lambda job: -len(job[0].package.definitions))
    with get_context("fork").Pool(native.cpu_count()) as pool:
        pool.starmap(generators.generate, jobs, chunksize=1)
    _report(started, "generated their sources")

    include_dirs = [work_dir / name for name in generators.GENERATORS]
    units = {d.package.name: native.write_units(d, object_dir) for d in described}
    native.compile_units([u for us in units.values() for u in us], include_dirs, toolchain)
    _report(started, f"compiled {sum(map(len, units.values()))} translation units")

    modules: dict[str, Path] = {}
    for d in described:
        package = d.package
        target = target_root / package.name / module_file_name(package)
        objects = [unit.path.with_name(unit.path.name + ".o") for unit in units[package.name]]
        shutil.copytree(d.sources_dir("python"), target.parent, ignore=shutil.ignore_patterns("*.c", "*.h"))
        native.link(target, objects, {n: m for n, m in modules.items() if n in package.depends}, toolchain)
        modules[package.name] = target
    _report(started, f"linked {', '.join(modules)} into {os.path.relpath(target_root)}")


def _report(started: float, what: str) -> None:
    print(f"rosidl_build: {time.monotonic() - started:5.1f} s  {what}", flush=True)
