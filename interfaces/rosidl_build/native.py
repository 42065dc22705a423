"""Compiles the generated sources of a package and links them into one extension module.

Hundreds of small files are compiled as a few translation units that include them. All parts of a package (C structs, both type
supports, dispatch, Python bindings) are linked into the one library that Python imports.
"""

import os
import shlex
import subprocess
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from .generators import GENERATORS, DescribedPackage
from .toolchain import Toolchain

SELF_LOOKUP = Path(__file__).with_name("self_lookup.c")
STOCK_LOOKUPS = {
    "rosidl_typesupport_c__get_message_typesupport_handle_function": "rosidl_build_message_type_support",
    "rosidl_typesupport_c__get_service_typesupport_handle_function": "rosidl_build_service_type_support",
}
"""Functions of librosidl_typesupport_c, and their replacements in self_lookup.c."""

RUNTIME_LIBRARIES = (
    "rosidl_runtime_c",
    "rosidl_typesupport_c",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_typesupport_fastrtps_cpp",
    "rosidl_typesupport_introspection_c",
    "rcutils",
    "rmw",
    "fastcdr",
)
GENERATED_LIBRARIES = (
    "rosidl_generator_c",
    "rosidl_generator_py",
    "rosidl_typesupport_c",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_typesupport_introspection_c",
)


@dataclass(frozen=True)
class TranslationUnit:
    """A file to compile, and the number of generated sources that it includes, as its weight in the order of compilation."""

    path: Path
    weight: int

    @property
    def object(self) -> Path:
        """The object file."""
        return self.path.with_name(self.path.name + ".o")


def write_units(described: DescribedPackage, object_dir: Path) -> list[TranslationUnit]:
    """Write the translation units of a package."""
    object_dir.mkdir(parents=True)
    groups: dict[str, list[Path]] = {}
    for generator in GENERATORS:
        root = described.sources_dir(generator)
        for source in sorted(p for p in root.rglob("*.c*") if p.suffix in (".c", ".cpp")):
            groups.setdefault(_unit_name(source, root, generator), []).append(source)
    units = []
    for name, sources in groups.items():
        path = object_dir / name
        path.write_text("".join(f'#include "{source}"\n' for source in sources))
        units.append(TranslationUnit(path, len(sources)))
    return [*units, _self_lookup_unit(object_dir)]


def _self_lookup_unit(object_dir: Path) -> TranslationUnit:
    path = object_dir / SELF_LOOKUP.name
    path.write_text(f'#include "{SELF_LOOKUP}"\n')
    return TranslationUnit(path, 1)


def _unit_name(source: Path, root: Path, generator: str) -> str:
    kind = source.relative_to(root).parts[0]
    if source.parent == root:
        return f"module{source.suffix}"  # defines PyInit_*
    if source.name.endswith("__description.c"):
        return f"{kind}.{source.name}"  # separate units, because their file-level names clash
    return f"{kind}.{generator}{source.suffix}"


def compile_units(units: Iterable[TranslationUnit], include_dirs: Iterable[Path], toolchain: Toolchain) -> None:
    """Compile translation units in parallel, the heaviest first."""
    flags = ["-fPIC", "-w", "-DNDEBUG", toolchain.optimization]
    flags += [f"-D{stock}={ours}" for stock, ours in STOCK_LOOKUPS.items()]
    flags += [f"-I{folder}" for folder in (*include_dirs, *toolchain.include_dirs)]

    def compile_one(unit: TranslationUnit) -> None:
        is_cxx = unit.path.suffix == ".cpp"
        compiler = [*toolchain.cxx_compiler, "-std=c++17"] if is_cxx else [*toolchain.c_compiler, "-std=gnu11"]
        _run([*compiler, *flags, "-c", str(unit.path), "-o", str(unit.object)])

    with ThreadPoolExecutor(cpu_count()) as pool:
        list(pool.map(compile_one, sorted(units, key=lambda unit: -unit.weight)))


def link(target: Path, objects: Iterable[Path], siblings: dict[str, Path], toolchain: Toolchain) -> None:
    """Link an extension module.

    ``siblings`` are the modules of packages that this one may use, by package name. At run time the module finds them
    and the ROS libraries by relative paths: ``site-packages/<package>/`` to ``site-packages/`` and ``<prefix>/lib``.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    libraries = [f"-l:lib{name}.so" for name in RUNTIME_LIBRARIES]
    for kind in GENERATED_LIBRARIES:
        libraries += [f"-l:{p.name}" for p in sorted(toolchain.library_dir.glob(f"lib*__{kind}.so"))]
    sibling_flags = [flag for path in siblings.values() for flag in (f"-L{path.parent}", f"-l:{path.name}")]
    run_paths = ["$ORIGIN/../../..", *(f"$ORIGIN/../{name}" for name in siblings)]
    _run([
        *toolchain.cxx_compiler, "-shared", "-s", "-o", str(target), f"-Wl,-soname,{target.name}",
        *map(str, objects),
        f"-L{toolchain.library_dir}", "-Wl,--as-needed", *sibling_flags, *libraries, "-ldl",
        *(f"-Wl,-rpath,{path}" for path in run_paths),
    ])  # fmt: skip


def cpu_count() -> int:
    """The number of cores that this process may use; in a container it can be fewer than the machine has."""
    return len(os.sched_getaffinity(0))


def _run(command: list[str]) -> None:
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if result.returncode:
        raise SystemExit(f"{shlex.join(command)}\nexited with status {result.returncode}:\n{result.stdout}")
