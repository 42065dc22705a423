"""Generates C, C++ and Python sources from definitions, with the official rosidl generators of the ROS wheels.

Two steps, as in a CMake build: ``describe`` turns each .msg, .srv and .action into .idl and a type description with its
hash; ``generate`` then runs one generator over a described package.
"""

import importlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from .packages import InterfacePackage

TYPE_SUPPORTS = ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]
"""The type supports that rcl needs: serialization and introspection."""


@dataclass(frozen=True)
class Generator:
    """One rosidl generator: its Python package, and the call of its entry point with an arguments file."""

    package: str
    run: Callable[[ModuleType, str], Any]


GENERATORS = {
    "c": Generator("rosidl_generator_c", lambda module, args: module.generate_c(args)),
    "introspection": Generator("rosidl_typesupport_introspection_c", lambda module, args: module.generate_c(args)),
    "fastrtps": Generator("rosidl_typesupport_fastrtps_c", lambda module, args: module.generate_typesupport_fastrtps_c(args)),
    "dispatch": Generator("rosidl_typesupport_c", lambda module, args: module.generate_c(args, TYPE_SUPPORTS)),
    "python": Generator("rosidl_generator_py", lambda module, args: module.generate_py(args, ["rosidl_typesupport_c"])),
}
"""The generators by the name of the folder of their output."""


@dataclass(frozen=True)
class DescribedPackage:
    """A package with .idl files and type descriptions, ready for the generators."""

    package: InterfacePackage
    work_dir: Path
    arguments: dict[str, Any]

    def sources_dir(self, generator: str) -> Path:
        """The output folder of ``generator``; its parent is an include folder."""
        return self.work_dir / generator / self.package.name


def known_type_descriptions(ros_prefix: Path) -> dict[str, Path]:
    """The folders of the type descriptions in the ROS wheels, by package."""
    return {p.name: p for p in (ros_prefix / "share").iterdir() if any((p / kind).is_dir() for kind in ("msg", "srv"))}


def description_dir(work_dir: Path, package: InterfacePackage) -> Path:
    """The folder of the type descriptions of ``package``."""
    return work_dir / "description" / package.name


def describe(package: InterfacePackage, work_dir: Path, descriptions: dict[str, Path]) -> DescribedPackage:
    """Write .idl files and type descriptions of ``package``.

    ``descriptions`` are the folders of other packages' type descriptions; those of dependencies must exist already.
    """
    from rosidl_adapter import convert_to_idl
    from rosidl_generator_type_description import generate_type_hash

    _cache_idl_parser()
    idl_dir = work_dir / "idl" / package.name
    output_dir = description_dir(work_dir, package)
    for definition in package.definitions:
        convert_to_idl(package.folder, package.name, definition, idl_dir)
    idl_files = [d.with_suffix(".idl") for d in package.definitions]
    arguments = {
        "package_name": package.name,
        "idl_tuples": [f"{idl_dir}:{idl}" for idl in idl_files],
        "target_dependencies": [],
        "ros_interface_dependencies": [],
    }
    include_paths = [f"{name}:{folder}" for name, folder in descriptions.items()]
    generate_type_hash(
        _write_arguments(
            work_dir / f"{package.name}.description.json",
            {**arguments, "output_dir": str(output_dir), "template_dir": "", "include_paths": include_paths},
        )
    )
    arguments["type_description_tuples"] = [f"{idl}:{output_dir / idl.with_suffix('.json')}" for idl in idl_files]
    arguments["ros_interface_files"] = [str(package.folder / d) for d in package.definitions]
    return DescribedPackage(package, work_dir, arguments)


def generate(described: DescribedPackage, name: str, ros_prefix: Path) -> None:
    """Run the generator called ``name`` over a described package.

    Call it in a separate process, because the template engine has global state.
    """
    _cache_idl_parser()
    generator = GENERATORS[name]
    resource = ros_prefix / "share" / generator.package / "resource"
    output_dir = described.sources_dir(name)
    output_dir.mkdir(parents=True)
    arguments = {**described.arguments, "output_dir": str(output_dir), "template_dir": str(resource)}
    path = described.work_dir / f"{described.package.name}.{name}.json"
    generator.run(importlib.import_module(generator.package), _write_arguments(path, arguments))
    if name == "python":
        (output_dir / "__init__.py").write_text("")
    _write_visibility_header(resource, generator.package, described.package.name, output_dir)


def _write_visibility_header(resource: Path, generator_package: str, package: str, output_dir: Path) -> None:
    """Fill in the header that CMake's configure_file() would write."""
    template = resource / f"{generator_package}__visibility_control.h.in"
    if template.exists():
        text = template.read_text().replace("@PROJECT_NAME_UPPER@", package.upper()).replace("@PROJECT_NAME@", package)
        (output_dir / "msg").mkdir(exist_ok=True)
        (output_dir / "msg" / template.stem).write_text(text)


def _write_arguments(path: Path, arguments: dict[str, Any]) -> str:
    path.write_text(json.dumps(arguments))
    return str(path)


_parsed: dict[str, Any] = {}
"""Parsed .idl files by path. It is filled before the generators' processes are forked, which inherit it."""


def _cache_idl_parser() -> None:
    """Cache the results of the IDL parser. Otherwise every generator parses every file (20 ms each), only to read the tree."""
    import rosidl_generator_py.generate_py_impl
    import rosidl_generator_type_description
    import rosidl_parser.parser
    import rosidl_pycommon

    parse = rosidl_parser.parser.parse_idl_file
    if parse.__module__ == __name__:
        return

    def parse_once(locator: Any, *args: Any) -> Any:
        path = str(locator.get_absolute_path())
        if path not in _parsed:
            _parsed[path] = parse(locator, *args)
        return _parsed[path]

    for module in (
        rosidl_parser.parser,
        rosidl_pycommon,
        rosidl_generator_type_description,
        rosidl_generator_py.generate_py_impl,
    ):
        module.parse_idl_file = parse_once
